"""The next experiment: of many poses and climates, those that tell the most.

Two rivals: the projected signal-to-noise of the doubtful finding with its rival in the model is
raised (T-optimal). Nothing in doubt: the standard uncertainty of the least well known parameter
is lowered (c-optimal). All other unknowns and a new placement are fitted along. Poses are taken
greedily, then exchanged while that helps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.compensation import parameters
from armd.compensation.arm import Arm
from armd.compensation.diagnose.conditions import (
    Climate,
    climates,
    draw_poses,
    in_climate,
    rows_of,
)
from armd.compensation.diagnose.diagnose import Diagnosis
from armd.compensation.diagnose.fit import Fit, finding_columns
from armd.compensation.diagnose.next import Doubt, most_doubtful
from armd.compensation.effects.effect import Candidate
from armd.compensation.kinematics import jacobian
from armd.compensation.state import States
from armd.errors import BadInput

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

MOST_EXCHANGES = 3
WORTHWHILE = 1.01  # least factor by which an exchange must help
WORTH_A_CLIMATE = 1.1  # least factor by which a climate must beat the reference temperature
#: Prior of the unknowns, as a share of what the whole pool would tell: makes gauges invertible.
RIDGE = 1e-9
#: A parameter of which less than this share stays when all others are fitted along, though the
#: whole pool is measured, is a gauge: the placement or the tip's offset does the same.
GAUGE_SHARE = 1e-5


@dataclass(frozen=True)
class Question:
    """What the experiment is asked, as directions in the space of unknowns."""

    words: str
    quantity: str
    unit: str
    directions: F64  # (k, m)
    amplitude: F64 | None  # (m,) that should stand out; None: the one direction's uncertainty

    def merit(self, covariance: F64) -> F64:
        """Figures of merit (n,), higher is better, of covariances (n, m, m) of the answer."""
        if self.amplitude is None:
            precision: F64 = 1.0 / np.sqrt(np.maximum(covariance[:, 0, 0], 1e-300))
            return precision
        wanted = np.broadcast_to(self.amplitude[:, None], (*covariance.shape[:2], 1))
        solved = np.linalg.solve(covariance, wanted)
        signal: F64 = np.sqrt(np.maximum(solved[:, :, 0] @ self.amplitude, 0.0))
        return signal

    def figure(self, merit: float) -> float:
        """A merit in `unit`."""
        return merit if self.amplitude is not None else 1.0 / merit


@dataclass(frozen=True)
class Experiment:
    """Chosen conditions, and what they are worth in the question's unit."""

    question: Question
    climate: Climate
    states: States  # of the chosen poses
    tip_mm: F64  # (n, 3) base frame
    before: float  # with the sessions there are
    after: float  # with the experiment
    parameters: F64  # (P,) of the model, for the picture


def design(diagnosis: Diagnosis, poses: int = 12, seed: int = 1) -> Experiment:
    """Choose a climate and *poses* poses for the next session, on one new placement.

    Raises `BadInput` when nothing is in doubt and the calibration tells no uncertainties.
    """
    last, arm = diagnosis.search.last, diagnosis.arm
    doubt = most_doubtful(diagnosis)
    candidates = [] if doubt is None else [last.findings[doubt.index], doubt.rival]
    known = _known(last, candidates, arm)
    drawn = draw_poses(diagnosis, seed)
    choices = [(c, in_climate(drawn, c, arm)) for c in climates(diagnosis)]
    rows = [rows_of(states, climate, last, candidates, arm) for climate, states in choices]
    pool = sum(_gram(whitened) for whitened, _ in rows)
    known = known + np.diag(RIDGE * np.diag(known + pool) + 1e-300)
    if doubt is None:
        question = _weakest(last, arm, known, known + pool, drawn)
    else:
        question = _rivals(doubt, last, len(known))
    greedy = [_greedy(known, whitened, question, poses) for whitened, _ in rows]
    reached = [
        _merit(known + _gram(whitened[chosen]), question)
        for (whitened, _), chosen in zip(rows, greedy, strict=True)
    ]
    best = int(np.argmax(reached))
    if reached[best] < WORTH_A_CLIMATE * reached[0]:
        best = 0
    (climate, states), (whitened, tip) = choices[best], rows[best]
    chosen = _exchanged(known, whitened, question, greedy[best])
    return Experiment(
        question,
        climate,
        states.rows(np.array(chosen, dtype=np.int64)),
        tip[chosen],
        question.figure(_merit(known, question)),
        question.figure(_merit(known + _gram(whitened[chosen]), question)),
        last.model.constants,
    )


def _rivals(doubt: Doubt, last: Fit, size: int) -> Question:
    first = last.layout.identified.stop - last.layout.identified.start
    amplitude = last.amplitudes[doubt.index]
    directions = np.eye(size)[:, first : first + len(amplitude)]
    quantity = "projected signal-to-noise of the first with the second in the model"
    return Question(doubt.words, quantity, "noise units", directions, amplitude)


def _weakest(last: Fit, arm: Arm, known: F64, richest: F64, poses: States) -> Question:
    """The constant known least well, in µm at the tip, of those that poses can settle at all."""
    baseline = last.baseline
    if not baseline.parameters:
        raise BadInput("calibration", "covariance", "none", "that of the constants to tighten")
    names = parameters.names(arm.n_joints)
    moves = jacobian(poses.q, last.model.constants)[1]  # (n, 3, P) mm per unit
    lever_um = 1e3 * np.sqrt((moves**2).sum(axis=1).mean(axis=0))
    indices = list(baseline.parameters)
    directions = np.zeros((len(known), len(indices)))
    if baseline.held:
        directions[: baseline.root.shape[1]] = baseline.root[: len(indices)].T
        settled = np.ones(len(indices), dtype=bool)
    else:
        directions[: len(indices)] = np.eye(len(indices))
        alone = np.diag(richest)[: len(indices)]
        settled = 1.0 / np.diag(_inverse(richest))[: len(indices)] > GAUGE_SHARE * alone
    directions *= lever_um[indices]
    variance = np.einsum("ki,kl,li->i", directions, _inverse(known), directions)
    weakest = int(np.argmax(np.where(settled, variance, -1.0)))
    name = names[indices[weakest]]
    return Question(
        f"tighten {name}, the least well known parameter",
        f"standard uncertainty of {name}",
        "µm at the tip",
        directions[:, weakest : weakest + 1],
        None,
    )


def _known(last: Fit, candidates: list[Candidate], arm: Arm) -> F64:
    """Information (k, k) of the sessions there are; of the placement to come, nothing."""
    own = last.absorbing.columns[:, last.layout.identified]
    wanted = last.noise.whiten(np.hstack([own, *finding_columns(last.linear, candidates, arm)]))
    others = np.ones(last.absorbing.columns.shape[1], dtype=bool)
    others[last.layout.identified] = False
    places = [candidate.place for candidate in candidates]
    for finding, at in zip(last.findings, last.layout.findings, strict=True):
        if finding.place in places:
            others[at] = False
    absorbing, scale = last.noise.whiten_to_unit(last.absorbing.columns[:, others])
    ridge = 1.0 / (last.absorbing.variance[others] * scale**2) + RIDGE
    across = absorbing.T @ wanted
    clear = wanted.T @ wanted - across.T @ np.linalg.solve(
        absorbing.T @ absorbing + np.diag(ridge), across
    )
    if last.baseline.held:  # the calibration's covariance: one per direction
        clear[: own.shape[1], : own.shape[1]] += np.eye(own.shape[1])
    known = np.zeros((len(clear) + 6, len(clear) + 6))
    known[:-6, :-6] = (clear + clear.T) / 2
    return known


def _gram(rows: F64) -> F64:
    flat = rows.reshape(-1, rows.shape[-1])
    gram: F64 = flat.T @ flat
    return gram


def _inverse(information: F64) -> F64:
    scale = np.sqrt(np.diag(information))
    inverse: F64 = np.linalg.inv(information / np.outer(scale, scale)) / np.outer(scale, scale)
    return inverse


def _merit(information: F64, question: Question) -> float:
    answer = question.directions.T @ _inverse(information) @ question.directions
    return float(question.merit(answer[None])[0])


def _with_each(information: F64, rows: F64, question: Question) -> F64:
    """Merits (n,) of *information* and one more reading, for each of rows (n, 3, k)."""
    covariance = _inverse(information)
    towards = covariance @ question.directions
    moved = rows @ towards
    spread = np.eye(3) + (rows @ covariance) @ rows.transpose(0, 2, 1)
    less = moved.transpose(0, 2, 1) @ np.linalg.solve(spread, moved)
    return question.merit(question.directions.T @ towards - less)


def _best(information: F64, rows: F64, question: Question, chosen: list[int]) -> tuple[int, float]:
    merit = _with_each(information, rows, question)
    merit[chosen] = -np.inf
    best = int(np.argmax(merit))
    return best, float(merit[best])


def _greedy(known: F64, rows: F64, question: Question, poses: int) -> list[int]:
    """The first few pay for the placement's six unknowns only; exchanges make good for them."""
    chosen: list[int] = []
    for _ in range(min(poses, len(rows))):
        total = known + _gram(rows[chosen])
        chosen.append(_best(total, rows, question, chosen)[0])
    return chosen


def _exchanged(known: F64, rows: F64, question: Question, chosen: list[int]) -> list[int]:
    chosen = list(chosen)
    for _ in range(MOST_EXCHANGES):
        changed = False
        for place in range(len(chosen)):
            others = chosen[:place] + chosen[place + 1 :]
            now = _merit(known + _gram(rows[chosen]), question)
            best, merit = _best(known + _gram(rows[others]), rows, question, chosen)
            if merit > WORTHWHILE * now:
                chosen[place], changed = best, True
        if not changed:
            break
    return chosen

"""The next experiment: of many poses and climates, those that tell the most.

All other unknowns and a new placement are fitted along. Poses are taken greedily, then exchanged
while that helps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.compensation.diagnose.conditions import (
    Climate,
    climates,
    draw_poses,
    in_climate,
    rows_of,
)
from armd.compensation.diagnose.diagnose import Diagnosis
from armd.compensation.diagnose.fit import Fit, finding_columns
from armd.compensation.diagnose.next import most_doubtful
from armd.compensation.diagnose.question import Question, between, weakest
from armd.compensation.effects.effect import Candidate
from armd.compensation.model.arm import Arm
from armd.compensation.model.state import States

F64 = npt.NDArray[np.float64]

FEW, MANY = 12, 24  # poses to choose unless told how many
TOLD_AT_ALL = 2.0  # noise units between two causes under which they are not told apart
MOST_EXCHANGES = 3
WORTHWHILE = 1.01  # least factor by which an exchange must help
WORTH_A_CLIMATE = 1.1  # least factor by which a climate must beat one of less trouble
#: Prior of the unknowns, as a share of what the whole pool would tell: makes gauges invertible.
RIDGE = 1e-9


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


def design(diagnosis: Diagnosis, poses: int | None = None, seed: int = 1) -> Experiment:
    """Choose a climate and *poses* poses for the next session, on one new placement.

    None: a dozen; more where they leave causes too close to each other.
    Raises `BadInput` when nothing is in doubt and the calibration tells no uncertainties.
    """
    last, arm = diagnosis.search.last, diagnosis.arm
    doubt = most_doubtful(diagnosis)
    candidates = []
    if doubt is not None:
        candidates = [last.findings[doubt.index], *doubt.rivals]
    known = _known(last, candidates, arm)
    drawn = draw_poses(diagnosis, seed)
    choices = [(c, in_climate(drawn, c, diagnosis)) for c in climates(diagnosis)]
    rows = [rows_of(states, climate, last, candidates, arm) for climate, states in choices]
    pool = sum(_gram(whitened) for whitened, _ in rows)
    known = known + np.diag(RIDGE * np.diag(known + pool) + 1e-300)
    question: Question
    if doubt is None:
        question = weakest(last, arm, known, known + pool, drawn)
    else:
        question = between(doubt, last, known, known + pool)
    greedy = [_greedy(known, whitened, question, poses or FEW) for whitened, _ in rows]
    reached = [
        _merit(known + _gram(whitened[chosen]), question)
        for (whitened, _), chosen in zip(rows, greedy, strict=True)
    ]
    best = int(np.argmax(WORTH_A_CLIMATE * np.array(reached) >= max(reached)))
    (climate, states), (whitened, tip) = choices[best], rows[best]
    chosen = _exchanged(known, whitened, question, greedy[best])
    if poses is None:
        more = _more(known, whitened, question, chosen)
        chosen = _exchanged(known, whitened, question, more) if len(more) > len(chosen) else chosen
    return Experiment(
        question,
        climate,
        states.rows(np.array(chosen, dtype=np.int64)),
        tip[chosen],
        question.figure(_merit(known, question)),
        question.figure(_merit(known + _gram(whitened[chosen]), question)),
        last.model.constants,
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


def _merit(information: F64, question: Question) -> float:
    return float(question.merit(information)[0])


def _best(information: F64, rows: F64, question: Question, chosen: list[int]) -> tuple[int, float]:
    merit = question.merit(information, rows)
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


def _more(known: F64, rows: F64, question: Question, chosen: list[int]) -> list[int]:
    """With as many more as settle the question, up to MANY; none if these hardly help."""
    more, merit = list(chosen), _merit(known + _gram(rows[chosen]), question)
    while len(more) < min(MANY, len(rows)) and not question.settled(merit):
        best, merit = _best(known + _gram(rows[more]), rows, question, more)
        more.append(best)
    return more if question.figure(merit) >= TOLD_AT_ALL else list(chosen)


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

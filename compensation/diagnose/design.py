"""The next experiment: of many conditions that could be measured, those that tell the most.

What is asked is one block of columns: the signature of a doubtful finding beside that of its
rival, or the least well known parameter. A condition's worth is how much it raises the asked
block's squared amplitude in units of noise, all other unknowns (and a new placement) fitted along
(T-optimal for two rivals, c-optimal for one parameter); conditions are taken greedily, then
exchanged while that helps.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.compensation import parameters
from armd.compensation.arm import Arm
from armd.compensation.basis import basis_values, parameter_rows
from armd.compensation.diagnose.diagnose import Diagnosis
from armd.compensation.diagnose.fit import Fit, finding_columns
from armd.compensation.diagnose.next import most_doubtful
from armd.compensation.diagnose.noise import LEVER_MM
from armd.compensation.effects.effect import Candidate
from armd.compensation.kinematics import jacobian, joint_jacobian
from armd.compensation.state import States
from armd.compensation.terms import Term

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

POOL = 300
#: Least height of the tip over the base, and reach kept clear around the column.
LOWEST_MM, CLEAR_MM = 0.0, 150.0
#: Temperatures to choose from, about the reference.
STEPS_K = (-5.0, 0.0, 5.0)
HEATED_K = 4.0  # of one link, by hand or by its own motor
RATE_RAD_S = 0.05
MOST_EXCHANGES = 3
#: Prior of the unknowns in the information, so that it can be inverted (mm, rad, K…: tiny).
RIDGE = 1e-6
#: A change of a parameter that should stand out, and the share of its information that must stay
#: when all others are fitted along for it to be settled at all.
CHANGE = {"mm": 5e-3, "rad": 1e-5}
LEAST_SHARE = 1e-5


@dataclass(frozen=True)
class Goal:
    """What the experiment is to decide, in words and as candidates."""

    words: str
    asked: Candidate | None  # the finding whose amplitude is to stand out …
    rival: Candidate | None  # … with this one in the model
    parameter: str = ""  # or the parameter to tighten


@dataclass(frozen=True)
class Experiment:
    """Chosen conditions, and what they are worth."""

    goal: Goal
    states: States  # of the chosen conditions
    tip_mm: F64  # (n, 3) base frame
    sigma_before: float  # the asked block in standard deviations, with the sessions there are
    sigma_after: float  # with the experiment
    parameters: F64  # (P,) of the model, for the picture


def design(diagnosis: Diagnosis, poses: int = 12, seed: int = 1) -> Experiment:
    """Choose *poses* conditions for the next session."""
    last, arm = diagnosis.search.last, diagnosis.arm
    goal = _doubt(diagnosis)
    columns = [] if goal is None else [c for c in (goal.asked, goal.rival) if c is not None]
    known = _known(last, columns, arm)
    if goal is None:
        goal = _weakest(diagnosis, known)
    pool = _pool(diagnosis, seed)
    rows, tip = _rows(pool, last, columns, arm)
    asked, amplitude = _asked(goal, last, arm, diagnosis.baseline.parameters)
    chosen = _choose(known, rows, asked, amplitude, poses)
    after = _worth(known + _gram(rows[chosen]), asked, amplitude)
    return Experiment(
        goal,
        pool.rows(np.array(chosen, dtype=np.int64)),
        tip[chosen],
        float(np.sqrt(_worth(known, asked, amplitude))),
        float(np.sqrt(after)),
        last.model.constants,
    )


def _named(candidate: Candidate) -> str:
    place = "" if candidate.cause == "unknown" else f" ({candidate.location})"
    return candidate.cause.replace("_", " ") + place


def _doubt(diagnosis: Diagnosis) -> Goal | None:
    """The most doubtful finding against its rival."""
    worst = most_doubtful(diagnosis)
    if worst is None:
        return None
    rival = worst.rivals[0].candidate
    words = f"tell {_named(worst.candidate)} from {_named(rival)}"
    return Goal(words, worst.candidate, rival)


def _weakest(diagnosis: Diagnosis, known: F64) -> Goal:
    """The least well known of the constants that an experiment can settle at all."""
    baseline = diagnosis.baseline
    names = [parameters.names(diagnosis.arm.n_joints)[i] for i in baseline.parameters]
    change = np.array([CHANGE[parameters.unit(name)] for name in names])
    if baseline.held:
        worth = change / np.sqrt((baseline.root[: len(names)] ** 2).sum(axis=1))
    else:
        settled = np.array([_worth(known, np.array([i]), np.ones(1)) for i in range(len(names))])
        own = np.diag(known)[: len(names)]
        worth = change * np.sqrt(settled)
        worth[settled < LEAST_SHARE * own] = np.inf  # a gauge: the tip's, the mount's
    name = names[int(np.argmin(worth))]
    size = "5 µm" if parameters.unit(name) == "mm" else "10 µrad"
    words = f"tighten {name}, the least well known parameter (a change of {size})"
    return Goal(words, None, None, name)


def _known(last: Fit, columns: list[Candidate], arm: Arm) -> F64:
    """Information (k, k) of the sessions there are on [constants, extra columns], and on the six
    of a placement to come (nothing)."""
    own = last.absorbing.columns[:, last.layout.identified]
    extra = finding_columns(last.linear, columns, arm)
    wanted = last.noise.whiten(np.hstack([own, *extra]))
    others = np.ones(last.absorbing.columns.shape[1], dtype=bool)
    others[last.layout.identified] = False
    for finding, at in zip(last.findings, last.layout.findings, strict=True):
        if any(finding.place == candidate.place for candidate in columns):
            others[at] = False
    absorbing = last.noise.whiten(last.absorbing.columns[:, others])
    ridge = 1.0 / last.absorbing.variance[others]
    gram = absorbing.T @ absorbing + np.diag(ridge + RIDGE)
    across = absorbing.T @ wanted
    clear = wanted.T @ wanted - across.T @ np.linalg.solve(gram, across)
    size = clear.shape[0] + 6
    known = RIDGE * np.eye(size)
    known[:-6, :-6] += (clear + clear.T) / 2
    return known


def _pool(diagnosis: Diagnosis, seed: int) -> States:
    """Conditions to choose from: poses within the limits, from either side, at temperatures."""
    arm = diagnosis.arm
    rng = np.random.default_rng(seed)
    seen = diagnosis.search.last.linear.rests.observations.states
    low = np.array([np.radians(j.min_deg) if j.min_deg is not None else -np.pi for j in arm.joint])
    high = np.array([np.radians(j.max_deg) if j.max_deg is not None else np.pi for j in arm.joint])
    constants = diagnosis.search.last.model.constants
    q = rng.uniform(low, high, (12 * POOL, arm.n_joints))
    position = jacobian(q, constants)[0]
    clear = (position[:, 2] > LOWEST_MM) & (np.hypot(*position[:, :2].T) > CLEAR_MM)
    q = q[clear][:POOL]
    n = len(q)
    temperature = np.full((n, len(arm.sensors)), diagnosis.search.last.model.reference_c)
    temperature += rng.choice(STEPS_K, n)[:, None]
    if arm.sensors and np.isfinite(seen.temperature_c).any():
        warm = rng.integers(len(arm.sensors), size=n)
        temperature[np.arange(n), warm] += rng.choice([0.0, HEATED_K], n)
    approach = rng.normal(size=(n, 3))
    approach /= np.linalg.norm(approach, axis=1, keepdims=True)
    return States(
        q=q,
        rate=RATE_RAD_S * rng.choice([-1.0, 1.0], q.shape),
        temperature_c=temperature,
        time_s=np.full(n, seen.time_s.max() + 86400.0),
        approach=approach,
        series=np.arange(n),
    )


def _rows(pool: States, last: Fit, columns: list[Candidate], arm: Arm) -> tuple[F64, F64]:
    """Whitened rows (n, 3, k) of every condition, and the tips (n, 3) mm."""
    model = last.linear.model
    values = basis_values(model.terms, pool, arm, model.reference_c, model.constants)
    p = parameter_rows(model.constants, model.terms, values)
    position, jac = jacobian(pool.q, p)
    turning = joint_jacobian(pool.q, p) / LEVER_MM
    share, scale = last.noise.encoder_share, last.noise.scale_mm
    blocks = share * turning @ turning.transpose(0, 2, 1) + (1 - share) * np.eye(3)
    whitener = np.linalg.inv(np.linalg.cholesky(blocks)) / scale
    own = _own_rows(pool, last, jac, arm)
    extra = [
        _column_rows(list(column.terms), pool, jac, last, arm)
        for candidate in columns
        for column in candidate.columns
    ]
    placement = np.zeros((len(position), 3, 6))
    placement[:, :, :3] = -np.eye(3)
    lever = (position - position.mean(axis=0)) / 100.0
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        placement[:, i, 3 + j], placement[:, j, 3 + i] = -lever[:, k], lever[:, k]
    stacked = np.concatenate([own, *(e[:, :, None] for e in extra), placement], axis=2)
    return whitener @ stacked, position


def _own_rows(pool: States, last: Fit, jac: F64, arm: Arm) -> F64:
    """Rows (n, 3, identified) of the constants and terms (or their covariance's directions)."""
    baseline = last.baseline
    names = {name: i for i, name in enumerate(parameters.names(arm.n_joints))}
    model = baseline.model
    terms = [model.terms[i].model_copy(update={"coefficient": 1.0}) for i in baseline.terms]
    values = basis_values(terms, pool, arm, model.reference_c, model.constants)
    slopes = [
        jac[:, :, names[t.parameter]] * v[:, None] for t, v in zip(terms, values.T, strict=True)
    ]
    own = np.stack([*(jac[:, :, i] for i in baseline.parameters), *slopes], axis=2)
    return own @ baseline.root if baseline.held else own


def _column_rows(terms: list[Term], pool: States, jac: F64, last: Fit, arm: Arm) -> F64:
    names = {name: i for i, name in enumerate(parameters.names(arm.n_joints))}
    model = last.linear.model
    values = np.nan_to_num(basis_values(terms, pool, arm, model.reference_c, model.constants))
    total = np.zeros(jac.shape[:2])
    for term, value in zip(terms, values.T, strict=True):
        total += term.coefficient * value[:, None] * jac[:, :, names[term.parameter]]
    return total


def _asked(goal: Goal, last: Fit, arm: Arm, identified: tuple[int, ...]) -> tuple[I64, F64]:
    """Which unknowns are asked for, and the amplitude that should stand out."""
    if goal.asked is not None:
        first = last.layout.identified.stop - last.layout.identified.start
        index = [f.place for f in last.findings].index(goal.asked.place)
        return first + np.arange(len(goal.asked.columns)), last.amplitudes[index]
    at = [parameters.names(arm.n_joints)[i] for i in identified].index(goal.parameter)
    if last.baseline.held:  # the direction of the covariance that moves it most
        return np.array([int(np.argmax(np.abs(last.baseline.root[at])))]), np.ones(1)
    return np.array([at]), np.array([CHANGE[parameters.unit(goal.parameter)]])


def _gram(rows: F64) -> F64:
    flat = rows.reshape(-1, rows.shape[-1])
    gram: F64 = flat.T @ flat
    return gram


def _worth(information: F64, asked: I64, amplitude: F64) -> float:
    """Squared amplitude of the asked block in units of noise, everything else fitted along."""
    others = np.setdiff1d(np.arange(len(information)), asked)
    inner = information[np.ix_(others, others)]
    scale = np.sqrt(np.diag(inner))
    across = information[np.ix_(others, asked)] / scale[:, None]
    solved = np.linalg.solve(inner / np.outer(scale, scale), across)
    clear = information[np.ix_(asked, asked)] - across.T @ solved
    return max(float(amplitude @ clear @ amplitude), 0.0)


def _choose(known: F64, rows: F64, asked: I64, amplitude: F64, poses: int) -> list[int]:
    """Greedy, then exchange. The first few only pay for the placement's six unknowns."""
    grams = np.einsum("nri,nrj->nij", rows, rows)
    chosen: list[int] = []
    total = known.copy()
    for _ in range(poses):
        worth = [_worth(total + gram, asked, amplitude) for gram in grams]
        for i in chosen:
            worth[i] = -1.0
        chosen.append(int(np.argmax(worth)))
        total += grams[chosen[-1]]
    for _ in range(MOST_EXCHANGES):
        changed = False
        for place in range(len(chosen)):
            without = total - grams[chosen[place]]
            worth = [_worth(without + gram, asked, amplitude) for gram in grams]
            for i in chosen:
                worth[i] = -1.0
            best = int(np.argmax(worth))
            if worth[best] > 1.01 * _worth(total, asked, amplitude):
                chosen[place], total, changed = best, without + grams[best], True
        if not changed:
            break
    return chosen

"""Design the next experiment: choose the most informative of many poses and climates.

All other unknowns and a new placement are fitted along. Poses are chosen greedily, then exchanged
while that helps.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from armd.arrays import F64
from armd.compensation.design.conditions import (
    Climate,
    draw_poses,
    list_climates,
    set_climate,
    whiten_rows,
)
from armd.compensation.design.criterion import (
    ASKED,
    Criterion,
    compare_causes,
    find_weakest,
)
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.layout import IDENTIFIED, name_block
from armd.compensation.diagnose.problem.signatures import make_finding_columns
from armd.compensation.diagnose.report.advice import find_most_doubtful
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.linear.linear_model import Layout, LinearModel
from armd.compensation.model.arm import Arm
from armd.compensation.model.state import States

FEW, MANY = 12, 24  # poses to choose if no number is given
LEAST_SEPARATION = 2.0  # noise units between two causes below which more poses are no help
MOST_EXCHANGES = 3
WORTHWHILE = 1.01  # least factor by which an exchange must improve the criterion
WORTH_A_CLIMATE = 1.1  # least factor by which a climate must beat an easier one
PLACEMENT = "placement"  # of the poses to be chosen
#: Prior of the unknowns, as a share of the whole pool's information: makes gauges invertible.
RIDGE = 1e-9


@dataclass(frozen=True)
class Experiment:
    """The chosen conditions, and their value in the criterion's unit."""

    criterion: Criterion
    climate: Climate
    states: States  # of the chosen poses
    tip_mm: F64  # (n, 3) base frame
    before: float  # with the existing sessions
    after: float  # with the experiment
    parameters: F64  # (P,) of the model, for the picture


def design(diagnosis: Diagnosis, poses: int | None = None, seed: int = 1) -> Experiment:
    """Choose a climate and *poses* poses for the next session, in one new placement.

    None: a dozen; more where they leave causes too close to each other. Raises `BadInput` when
    nothing is in doubt and the calibration states no uncertainties.
    """
    last, arm = diagnosis.search.last, diagnosis.arm
    doubt = find_most_doubtful(diagnosis)
    candidates = []
    if doubt is not None:
        candidates = [last.findings[doubt.index], *doubt.rivals]
    prior = _make_prior(last, candidates, arm)
    drawn = draw_poses(diagnosis, seed)
    choices = [(c, set_climate(drawn, c, diagnosis)) for c in list_climates(diagnosis)]
    rows = [whiten_rows(states, climate, last, candidates, arm) for climate, states in choices]
    pool = reduce(LinearModel.add_rows, (whitened for whitened, _ in rows), prior)
    ridge_variance = 1.0 / (RIDGE * np.diag(pool.gram) + 1e-300)
    prior, pool = prior.with_variance(ridge_variance), pool.with_variance(ridge_variance)
    criterion: Criterion
    if doubt is None:
        criterion = find_weakest(last, arm, prior, pool, drawn)
    else:
        criterion = compare_causes(doubt, last, prior, pool)
    greedy = [_greedy(prior, whitened, criterion, poses or FEW) for whitened, _ in rows]
    reached = [
        _merit(prior.add_rows(whitened[chosen]), criterion)
        for (whitened, _), chosen in zip(rows, greedy, strict=True)
    ]
    best = int(np.argmax(WORTH_A_CLIMATE * np.array(reached) >= max(reached)))
    (climate, states), (whitened, tip) = choices[best], rows[best]
    chosen = _exchanged(prior, whitened, criterion, greedy[best])
    if poses is None:
        longer = _extend(prior, whitened, criterion, chosen)
        chosen = (
            _exchanged(prior, whitened, criterion, longer) if len(longer) > len(chosen) else chosen
        )
    return Experiment(
        criterion,
        climate,
        states.rows(np.array(chosen, dtype=np.int64)),
        tip[chosen],
        criterion.figure(_merit(prior, criterion)),
        criterion.figure(_merit(prior.add_rows(whitened[chosen]), criterion)),
        last.model.constants,
    )


def _make_prior(last: Fit, candidates: list[Candidate], arm: Arm) -> LinearModel:
    """Return the existing sessions' information on the unknowns; none on the new placement."""
    asked_columns = (
        np.hstack(make_finding_columns(last.linear, candidates, arm)) if candidates else None
    )
    problem = last.problem
    if asked_columns is not None:
        white = last.noise.whiten(asked_columns)
        free = np.full(asked_columns.shape[1], np.inf)
        problem = problem.add_block(ASKED, white.T @ white, last.across(asked_columns), free)
    # A finding that is asked about takes part as a candidate.
    places = [candidate.place for candidate in candidates]
    itself = [
        name_block(i)
        for i, placed_finding in enumerate(last.findings)
        if placed_finding.place in places
    ]
    blocks = [IDENTIFIED, ASKED] if candidates else [IDENTIFIED]
    information = problem.without(*itself).compute_information(*blocks)
    sizes = dict(problem.layout.sizes)
    layout = Layout((*((name, sizes[name]) for name in blocks), (PLACEMENT, 6)))
    extended = np.zeros((layout.n, layout.n))
    extended[: len(information), : len(information)] = information
    return LinearModel.from_products(layout, extended, np.full(layout.n, np.inf))


def _merit(information: LinearModel, criterion: Criterion) -> float:
    return float(criterion.merit(information)[0])


def _best(
    information: LinearModel, rows: F64, criterion: Criterion, chosen: list[int]
) -> tuple[int, float]:
    merit = criterion.merit(information, rows)
    merit[chosen] = -np.inf
    best = int(np.argmax(merit))
    return best, float(merit[best])


def _greedy(prior: LinearModel, rows: F64, criterion: Criterion, poses: int) -> list[int]:
    """Choose poses greedily.

    The first few only determine the placement's six unknowns; exchanges replace them afterwards.
    """
    chosen: list[int] = []
    for _ in range(min(poses, len(rows))):
        total = prior.add_rows(rows[chosen])
        chosen.append(_best(total, rows, criterion, chosen)[0])
    return chosen


def _extend(prior: LinearModel, rows: F64, criterion: Criterion, chosen: list[int]) -> list[int]:
    """Add as many poses as settle the criterion, up to MANY; none if these hardly help."""
    extended, merit = list(chosen), _merit(prior.add_rows(rows[chosen]), criterion)
    while len(extended) < min(MANY, len(rows)) and not criterion.settled(merit):
        best, merit = _best(prior.add_rows(rows[extended]), rows, criterion, extended)
        extended.append(best)
    return extended if criterion.figure(merit) >= LEAST_SEPARATION else list(chosen)


def _exchanged(prior: LinearModel, rows: F64, criterion: Criterion, chosen: list[int]) -> list[int]:
    chosen = list(chosen)
    for _ in range(MOST_EXCHANGES):
        changed = False
        for place in range(len(chosen)):
            unchanged = chosen[:place] + chosen[place + 1 :]
            now = _merit(prior.add_rows(rows[chosen]), criterion)
            best, merit = _best(prior.add_rows(rows[unchanged]), rows, criterion, chosen)
            if merit > WORTHWHILE * now:
                chosen[place], changed = best, True
        if not changed:
            break
    return chosen

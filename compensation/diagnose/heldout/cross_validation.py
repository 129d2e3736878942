"""The search repeated without some of the readings: what it is worth on those left out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.data.in_order import in_order
from armd.compensation.diagnose.constants import GAIN_BEGINS, GAIN_TAKES, REPEATED_WORK
from armd.compensation.diagnose.diagnosis import SearchResult
from armd.compensation.diagnose.fitting.neighbourhood import possible, stays_near
from armd.compensation.diagnose.fitting.refit import (
    refits_without,
    solve_shared_again,
    with_findings_unsolved,
)
from armd.compensation.diagnose.heldout.gain import groups_of, left_out
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.rests import folds_of
from armd.compensation.diagnose.scoring.candidates import PartedSurvey, ScoredCandidates
from armd.compensation.diagnose.search.selection import next_finding
from armd.compensation.diagnose.search.work import WorkBudget
from armd.compensation.effects.effect import join_finding
from armd.compensation.freed import give_back_freed
from armd.compensation.model.arm import Arm
from armd.compensation.progress import TellShare

#: What is skipped where the work is done before all causes were sought again.
REPEATED_FROM = "the search repeated without parts of the readings, from cause"


@dataclass(frozen=True)
class CrossValidated:
    """Squared held-out residuals (n,) mm² of each point, without findings and after each."""

    squares: list[F64]
    groups: I64


def cross_validate(
    result: SearchResult,
    parted: PartedSurvey | None,
    arm: Arm,
    progress: TellShare,
    work: WorkBudget | None = None,
) -> CrossValidated:
    """Leave placements out in turn and search the others anew, step by step; *parted*: the search's
    last survey, where it found anything; *work*: what is computed at most.

    Each fold's search chooses cause, place and grid value for itself among the whole catalogue.
    What it shares with the readings left out are the noise's variances, the clipping of tails and
    the point about which the model is linear. Where it finds less, nothing is gained there.
    """
    last = result.last
    folds = folds_of(last.linear.rests)
    points = last.linear.rests.points
    squares = [np.zeros(points.n) for _ in range(len(result.findings) + 1)]
    parts = [int(part) for part in np.unique(folds)]
    refits = refits_without(with_findings_unsolved(last, [], arm), [folds == p for p in parts])
    work = work or WorkBudget()
    shares = [work.of_one_in(len(parts)) for _ in parts]  # they go on beside each other
    starts = [
        (part, refit.with_subset([]), share)
        for part, refit, share in zip(parts, refits, shares, strict=True)
    ]
    give_back_freed()
    squares_of_parts = in_order(lambda start: _without(*start, folds, result, parted, arm), starts)
    for done, (part, of_steps) in enumerate(zip(parts, squares_of_parts, strict=True), 1):
        give_back_freed()
        progress("gain", GAIN_BEGINS + GAIN_TAKES * done / len(parts))
        for square, part_squares in zip(squares, of_steps, strict=True):
            square[folds[: points.n] == part] = part_squares
    for share in shares:
        work.take(share)
    return CrossValidated(squares, groups_of(points))


def _without(
    part: int,
    current: Fit,
    work: WorkBudget,
    folds: I64,
    result: SearchResult,
    parted: PartedSurvey | None,
    arm: Arm,
) -> list[F64]:
    """Squared residuals mm² of one part's rests, without findings, as in the *current* fit, and
    after each that the search on the others makes."""
    last, out = replace(result.last, noise=current.noise), folds == part
    squares = [left_out(current, out, arm)]
    if parted is None:  # nothing was found
        return squares
    first = scored = parted.without(part, current)
    while len(squares) <= len(result.findings):
        if not work.may_go_on:
            work.skip(f"{REPEATED_FROM} {len(squares)} on")
            squares += [squares[-1]] * (len(result.findings) + 1 - len(squares))
            break
        work.add(scored.n_products, REPEATED_WORK)
        candidate = next_finding(scored, result.tests)
        if candidate is None:  # nothing is gained by what the search on all readings found further
            squares += [squares[-1]] * (len(result.findings) + 1 - len(squares))
            break
        tried = solve_shared_again(
            last, join_finding(current.findings, candidate), arm, parted.is_eliminated
        )
        if not (stays_near(tried, arm) and all(map(possible, tried.findings, tried.amplitudes))):
            squares += [squares[-1]] * (len(result.findings) + 1 - len(squares))
            break
        current = tried
        squares.append(left_out(current, out, arm))
        give_back_freed()
        if len(squares) <= len(result.findings):
            projection = first.projection.with_findings_of(current)
            scored = ScoredCandidates(projection, projection.sums_with(first.sums))
    return squares

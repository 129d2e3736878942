"""The search repeated without some of the readings, and its error on those held out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.data.in_order import run_in_order
from armd.compensation.diagnose.constants import GAIN_BEGINS, GAIN_TAKES, REPEATED_WORK
from armd.compensation.diagnose.diagnosis import SearchResult
from armd.compensation.diagnose.fitting.refit import (
    make_refits_without,
    set_findings,
    solve_shared_again,
)
from armd.compensation.diagnose.heldout.gain import compute_heldout_squares, group_readings
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.rests import assign_folds
from armd.compensation.diagnose.scoring.candidates import PartedSurvey, ScoredCandidates
from armd.compensation.diagnose.search.selection import choose_finding
from armd.compensation.diagnose.search.work import WorkBudget
from armd.compensation.effects.effect import join_finding
from armd.compensation.freed import drop_freed
from armd.compensation.model.arm import Arm
from armd.compensation.progress import TellShare

#: The name of what is skipped if the bound on the work is reached first.
REPEATED_FROM = "the search repeated without parts of the readings, from cause"


@dataclass(frozen=True)
class CrossValidated:
    """Squared held-out residuals (n,) mm² of each point, without findings and after each."""

    squares: list[F64]
    groups: I64


def validate_in_turn(
    result: SearchResult,
    parted: PartedSurvey | None,
    arm: Arm,
    progress: TellShare,
    work: WorkBudget | None = None,
) -> CrossValidated:
    """Hold placements out in turn and repeat the search on the others, step by step.

    *parted*: the search's last survey, None where it found nothing. *work*: the bound on what is
    computed. Each fold's search chooses cause, place and grid value for itself from the whole
    catalogue. It shares with the held-out readings the noise's variances, the clipping of outliers
    and the point of linearisation. Where it finds less, that fold gains nothing.
    """
    last = result.last
    folds = assign_folds(last.linear.rests)
    points = last.linear.rests.points
    squares = [np.zeros(points.n) for _ in range(len(result.findings) + 1)]
    parts = [int(part) for part in np.unique(folds)]
    refits = make_refits_without(set_findings(last, [], arm), [folds == p for p in parts])
    work = work or WorkBudget()
    shares = [work.split(len(parts)) for _ in parts]  # the parts are computed in parallel
    starts = [
        (part, refit.with_subset([]), share)
        for part, refit, share in zip(parts, refits, shares, strict=True)
    ]
    drop_freed()
    squares_of_parts = run_in_order(
        lambda start: _repeat_search_without(*start, folds, result, parted, arm), starts
    )
    for done, (part, of_steps) in enumerate(zip(parts, squares_of_parts, strict=True), 1):
        drop_freed()
        progress("gain", GAIN_BEGINS + GAIN_TAKES * done / len(parts))
        for step_squares, part_squares in zip(squares, of_steps, strict=True):
            step_squares[folds[: points.n] == part] = part_squares
    for share in shares:
        work.take(share)
    return CrossValidated(squares, group_readings(points))


def _repeat_search_without(
    part: int,
    current: Fit,
    work: WorkBudget,
    folds: I64,
    result: SearchResult,
    parted: PartedSurvey | None,
    arm: Arm,
) -> list[F64]:
    """Return squared residuals mm² of one part's rests, without findings and after each.

    The *current* fit is the one without findings; the search on the other parts makes the findings.
    """
    last, out = replace(result.last, noise=current.noise), folds == part
    squares = [compute_heldout_squares(current, out, arm)]
    if parted is None:  # nothing was found
        return squares
    first = scored = parted.without(part, current)
    while len(squares) <= len(result.findings):
        if not work.may_go_on:
            work.skip(f"{REPEATED_FROM} {len(squares)} on")
            squares += [squares[-1]] * (len(result.findings) + 1 - len(squares))
            break
        work.add(scored.n_products, REPEATED_WORK)
        candidate = choose_finding(scored, result.tests)
        if candidate is None:  # further findings of the search on all readings gain nothing here
            squares += [squares[-1]] * (len(result.findings) + 1 - len(squares))
            break
        tried = solve_shared_again(
            last, join_finding(current.findings, candidate), arm, parted.is_eliminated
        )
        current = tried
        squares.append(compute_heldout_squares(current, out, arm))
        drop_freed()
        if len(squares) <= len(result.findings):
            projection = first.projection.with_findings_of(current)
            scored = ScoredCandidates(projection, projection.sums_with(first.sums))
    return squares

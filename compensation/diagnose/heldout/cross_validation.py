"""The search repeated without some of the readings: what it is worth on those left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.data.in_order import in_order
from armd.compensation.diagnose.diagnosis import SearchResult
from armd.compensation.diagnose.fitting.neighbourhood import possible, stays_near
from armd.compensation.diagnose.fitting.refit import solve_shared_again, with_findings_unsolved
from armd.compensation.diagnose.heldout.gain import folds_of, groups_of, left_out
from armd.compensation.diagnose.scoring.candidates import ScoredCandidates
from armd.compensation.diagnose.scoring.evidence import Sums, total
from armd.compensation.diagnose.scoring.projection import Projection, make_projection
from armd.compensation.diagnose.search.selection import next_finding
from armd.compensation.effects.effect import joined
from armd.compensation.freed import give_back_freed
from armd.compensation.model.arm import Arm
from armd.compensation.progress import TellShare


@dataclass(frozen=True)
class CrossValidated:
    """Squared held-out residuals (n,) mm² of each rest, without findings and after each."""

    squares: list[F64]
    groups: I64


def cross_validate(result: SearchResult, arm: Arm, progress: TellShare) -> CrossValidated:
    """Leave placements out in turn and search the others anew, step by step.

    Each fold's search chooses cause, place and grid value for itself among the whole catalogue.
    What it shares with the readings left out are the noise's variances, the clipping of tails and
    the point about which the model is linear. Where it finds less, nothing is gained there.
    """
    last = result.last
    folds = folds_of(last)
    squares = [np.zeros(last.linear.rests.n) for _ in range(len(result.found) + 1)]
    whole = make_projection(with_findings_unsolved(last, [], arm), arm, folds)
    by_part = whole.sums_by_part(result.signatures)
    give_back_freed()
    parts = [int(part) for part in np.unique(folds)]
    found = in_order(lambda part: _without(part, folds, result, whole, by_part), parts)
    for done, (part, of_steps) in enumerate(zip(parts, found, strict=True), 1):
        give_back_freed()
        progress("gain", 0.9 + 0.1 * done / len(parts))
        for square, own in zip(squares, of_steps, strict=True):
            square[folds == part] = own
    return CrossValidated(squares, groups_of(last.linear.rests.observations))


def _without(
    part: int, folds: I64, result: SearchResult, whole: Projection, by_part: Sequence[Sums]
) -> list[F64]:
    """Squared residuals mm² of one part's rests, without findings and after each that the search
    on the others makes."""
    last, arm, out = result.last, whole.arm, folds == part
    whitener = np.where(out[:, None, None], 0.0, last.noise.whitener)
    noise = replace(last.noise, whitener=whitener)
    current = solve_shared_again(last, [], noise, arm, whole.alone)
    squares = [left_out(current, out, arm)]
    first = scored = ScoredCandidates(
        whole.without(part, current),
        total([sums for i, sums in enumerate(by_part) if i != part]),
    )
    while len(squares) <= len(result.found):
        found = next_finding(scored, result.tests)
        if found is None:  # nothing is gained by what the search on all readings found further
            squares += [squares[-1]] * (len(result.found) + 1 - len(squares))
            break
        tried = solve_shared_again(last, joined(current.findings, found), noise, arm, whole.alone)
        if not (stays_near(tried, arm) and all(map(possible, tried.findings, tried.amplitudes))):
            squares += [squares[-1]] * (len(result.found) + 1 - len(squares))
            break
        current = tried
        squares.append(left_out(current, out, arm))
        give_back_freed()
        if len(squares) <= len(result.found):
            projection = first.projection.with_findings_of(current)
            scored = ScoredCandidates(projection, projection.sums_with(first.sums))
    return squares

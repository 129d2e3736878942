"""How much better the extended model is, on readings that had no part in it.

With sessions held out, models fitted to the others are evaluated on them. Without, whole
placements are left out in turn, and the search is repeated on the others.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.special import bdtrc

from armd.compensation.diagnose.fitting.curves import as_written
from armd.compensation.diagnose.fitting.fit import Fit, solve_again
from armd.compensation.diagnose.fitting.neighbourhood import possible, scale_kept, stays_near
from armd.compensation.diagnose.scoring.candidates import ScoredCandidates
from armd.compensation.diagnose.scoring.evidence import Sums, total
from armd.compensation.diagnose.scoring.projection import Projection, make_projection
from armd.compensation.diagnose.search import Progress, Result
from armd.compensation.diagnose.selection import joined, next_finding
from armd.compensation.estimate.folds import blocks_of_time, whole_groups
from armd.compensation.estimate.observations import Observations
from armd.compensation.model.arm import Arm

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

MOST_FOLDS = 4
BLOCKS = 5  # of readings, where there is one placement only
#: Readings with truth of their own share nothing but their time: they are resampled in blocks.
TRUTH_BLOCKS = 40
RESAMPLES = 1000
SIGN_P = 0.01
#: Less than this share of the error is rounding, no gain.
LEAST_SHARE = 1e-6
#: In a decision a reading six noise units off counts as one that is further off: so many times the
#: usual squared residual.
MOST_SQUARES = 15.0


@dataclass(frozen=True)
class Gain:
    """3-D RMS on held-out readings before and after a finding, and 95 % of their difference."""

    before_um: float
    after_um: float
    interval_um: tuple[float, float]
    shown: bool  # held-out readings improve beyond doubt
    #: before and after, the rows named as outliers left out of both, where there are some
    without_outliers_um: tuple[float, float] | None = None


def gains(squares: Sequence[F64], groups: I64, kept: Mask) -> list[Gain]:
    """Gains from step to step of squared residuals (n,) mm², resampled by *groups* (n,).

    *kept* (n,): rows of the last figure; the others are what an outlier finding names.
    """
    last = len(squares) - 1
    every = np.ones(len(groups), dtype=bool)
    return [
        gain(squares[j - 1], squares[j], groups, kept if j == last else every)
        for j in range(1, len(squares))
    ]


def gain(before: F64, after: F64, groups: I64, use: Mask | None = None, seed: int = 1) -> Gain:
    """From squared residuals *before* to those *after* (n,) mm², of *use* (n,) only."""
    use = np.ones(len(groups), dtype=bool) if use is None else use
    names, index = np.unique(groups, return_inverse=True)
    draws = np.random.default_rng(seed).integers(len(names), size=(RESAMPLES, len(names)))
    sums = [
        np.bincount(index, values, len(names))
        for values in (before, np.ones(len(groups)), after * use, use.astype(float))
    ]
    drawn = [total[draws].sum(axis=1) for total in sums]
    change = np.sqrt(drawn[0] / drawn[1]) - np.sqrt(drawn[2] / np.maximum(drawn[3], 1.0))
    low, high = np.quantile(1e3 * change, [0.025, 0.975])
    rms = _rms(before), _rms(after[use])
    better = rms[1] < (1.0 - LEAST_SHARE) * rms[0]
    shown = better and (low > 0 or _most_improve(index, before, after))
    return Gain(*rms, (float(low), float(high)), bool(shown))


def without_gross(before: F64, after: F64) -> tuple[F64, F64]:
    """Squared residuals with single readings counting at most `MOST_SQUARES` of the usual one's:
    a decision that gross errors cannot outvote."""
    most = MOST_SQUARES * min(float(np.median(before)), float(np.median(after)))
    return np.minimum(before, most), np.minimum(after, most)


def _most_improve(index: I64, before: F64, after: F64) -> bool:
    """Whether most groups improve, by the sign test: a few readings that the model was never
    shown anything like may spoil a mean that is right for all the others."""
    change = np.bincount(index, before) - np.bincount(index, after)
    better, worse = int((change > 0).sum()), int((change < 0).sum())
    return bool(bdtrc(better - 1, better + worse, 0.5) < SIGN_P) if better else False


def _rms(squares: F64) -> float:
    return 1e3 * float(np.sqrt(squares.mean())) if squares.size else 0.0


@dataclass(frozen=True)
class CrossValidated:
    """Squared held-out residuals (n,) mm² of each rest, without findings and after each."""

    squares: list[F64]
    groups: I64


def cross_validate(result: Result, arm: Arm, progress: Progress) -> CrossValidated:
    """Leave placements out in turn and search the others anew, step by step.

    Each fold's search chooses cause, place and grid value for itself among the whole catalogue.
    What it shares with the readings left out are the noise's variances, the clipping of tails and
    the point about which the model is linear. Where it finds less, nothing is gained there.
    """
    last = result.last
    folds = folds_of(last)
    squares = [np.zeros(last.linear.rests.n) for _ in range(len(result.found) + 1)]
    whole = make_projection(solve_again(last, [], last.noise, arm), arm, folds)
    by_part = whole.sums_by_part(result.signatures)
    parts = [int(part) for part in np.unique(folds)]
    with ThreadPoolExecutor(min(len(parts), os.cpu_count() or 1)) as pool:
        found = pool.map(lambda part: _without(part, folds, result, whole, by_part), parts)
        for done, (part, of_steps) in enumerate(zip(parts, found, strict=True), 1):
            progress("gain", 0.9 + 0.1 * done / len(parts))
            for square, own in zip(squares, of_steps, strict=True):
                square[folds == part] = own
    return CrossValidated(squares, groups_of(last.linear.rests.observations))


def _without(
    part: int, folds: I64, result: Result, whole: Projection, by_part: Sequence[Sums]
) -> list[F64]:
    """Squared residuals mm² of one part's rests, without findings and after each that the search
    on the others makes."""
    last, arm, out = result.last, whole.arm, folds == part
    whitener = np.where(out[:, None, None], 0.0, last.noise.whitener)
    noise = replace(last.noise, whitener=whitener)
    current = solve_again(last, [], noise, arm)
    squares = [left_out(current, out, last.baseline.held) * scale_kept(current, arm) ** 2]
    first = scored = ScoredCandidates(
        whole.without(part, current),
        total([sums for i, sums in enumerate(by_part) if i != part]),
    )
    while len(squares) <= len(result.found):
        found = next_finding(scored, result.tests)
        if found is None:  # nothing is gained by what the search on all readings found further
            squares += [squares[-1]] * (len(result.found) + 1 - len(squares))
            break
        tried = solve_again(last, joined(current.findings, found), noise, arm)
        if not (stays_near(tried, arm) and all(map(possible, tried.findings, tried.amplitudes))):
            squares += [squares[-1]] * (len(result.found) + 1 - len(squares))
            break
        current = tried
        squares.append(left_out(current, out) * scale_kept(current, arm) ** 2)
        if len(squares) <= len(result.found):
            projection = first.projection.with_findings_of(current)
            scored = ScoredCandidates(projection, projection.sums_with(first.sums))
    return squares


def groups_of(observations: Observations) -> I64:
    """(n,) what readings are resampled by: placement and target, or blocks of time."""
    groups = observations.placement * len(observations.target_names) + observations.target
    truth = observations.has_truth
    if truth.any():
        blocks = blocks_of_time(observations.states.time_s[truth], TRUTH_BLOCKS)
        groups[truth] = groups.max() + 1 + blocks
    return groups


def left_out(current: Fit, out: Mask, as_given: bool = False) -> F64:
    """Squared residuals mm² of the rests left *out*, under the model of the others; or with the
    constants and terms *as_given* by the calibration under test, not moved within its covariance.

    Poses, seats, targets and drift are fitted to the readings left out themselves.
    """
    n = 3 * len(out)
    rows = np.flatnonzero(np.repeat(out, 3))
    arm = _of_the_arm(current)
    if as_given:
        arm = arm[arm >= current.layout.identified.stop]
    taken = current.nuisance.columns[:n, arm] @ current.solution[arm]
    for at, strange, columns in as_written(current, out):
        known = current.nuisance.columns[strange, at]
        taken[strange] += (columns - known) @ current.solution[at]
    left = (current.raw_residual[:n] - taken)[rows]
    own = current.linear.nuisance[rows]
    own = own[:, np.abs(own).max(axis=0) > 0]
    # A gross error must not carry its placement away from all the others.
    clipped = (current.residual[:n] - taken)[rows]
    left = left - own @ np.linalg.lstsq(own, clipped, rcond=1e-9)[0]
    square: F64 = (left.reshape(-1, 3) ** 2).sum(axis=1)
    return square


def _of_the_arm(last: Fit) -> I64:
    """Columns whose solution carries over to other placements: the arm's, and the findings'."""
    at = last.layout
    mount = at.findings[-1].stop if at.findings else at.identified.stop
    return np.concatenate(
        [
            np.arange(at.identified.start, at.identified.stop),
            *(np.arange(f.start, f.stop) for f in at.findings),
            np.arange(mount, at.shared),
        ]
    )


def folds_of(last: Fit) -> I64:
    """Fold of each rest: whole placements, dealt in turn; blocks of time for a single one."""
    observations = last.linear.rests.observations
    folds = whole_groups(observations.placement, MOST_FOLDS)
    return folds if folds.any() else blocks_of_time(observations.states.time_s, BLOCKS)

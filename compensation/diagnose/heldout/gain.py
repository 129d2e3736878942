"""The gain of the extended model on readings that were not used to make it.

With held-out sessions, models fitted to the others are evaluated on them. Without, whole placements
are held out in turn, and the search is repeated on the others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import ndtr, stdtrit

from armd.arrays import F64, I64, Mask
from armd.compensation.diagnose.constants import (
    INTERVAL_TAIL,
    LEAST_GAIN_SHARE,
    MOST_SQUARES,
    RANK_SHARE,
    RESAMPLES,
    TRUTH_BLOCKS,
)
from armd.compensation.diagnose.diagnosis import Gain
from armd.compensation.diagnose.fitting.curves import list_unknown_columns
from armd.compensation.diagnose.fitting.neighbourhood import compute_scale_factor
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.estimate.folds import assign_posture_folds
from armd.compensation.estimate.observations import Observations
from armd.compensation.model.arm import Arm


def compute_gains(squares: Sequence[F64], groups: I64, is_used: Mask) -> list[Gain]:
    """Return gains from step to step of squared residuals (n,) mm², resampled by *groups* (n,).

    *is_used* (n,): rows of the last figure; the others are those that an outlier finding lists.
    """
    last = len(squares) - 1
    every = np.ones(len(groups), dtype=bool)
    return [
        compute_gain(squares[j - 1], squares[j], groups, is_used if j == last else every)
        for j in range(1, len(squares))
    ]


def compute_gain(
    before: F64, after: F64, groups: I64, use: Mask | None = None, seed: int = 1
) -> Gain:
    """Return the gain from squared residuals *before* to those *after* (n,) mm².

    *use* (n,): the rows that count in *after*; all count in *before*. *groups* (n,): what is
    resampled.
    """
    use = np.ones(len(groups), dtype=bool) if use is None else use
    names, index = np.unique(groups, return_inverse=True)
    draws = np.random.default_rng(seed).integers(len(names), size=(RESAMPLES, len(names)))
    sums = [
        np.bincount(index, values, len(names))
        for values in (before, np.ones(len(groups)), after * use, use.astype(float))
    ]
    drawn = [total[draws].sum(axis=1) for total in sums]
    change = np.sqrt(drawn[0] / drawn[1]) - np.sqrt(drawn[2] / np.maximum(drawn[3], 1.0))
    low, high = np.quantile(1e3 * change, _compute_tails(len(names)))
    rms = _compute_rms_um(before), _compute_rms_um(after[use])
    better = rms[1] < (1.0 - LEAST_GAIN_SHARE) * rms[0]
    return Gain(*rms, (float(low), float(high)), bool(better and low > 0))


def limit_squares(before: F64, after: F64) -> tuple[F64, F64]:
    """Limit squared residuals to `MOST_SQUARES` times the usual one's.

    So a decision does not depend on gross errors.
    """
    cap = MOST_SQUARES * min(float(np.median(before)), float(np.median(after)))
    return np.minimum(before, cap), np.minimum(after, cap)


def _compute_tails(n: int) -> tuple[float, float]:
    """Return shares of resamplings of *n* groups below and above a 95 % interval.

    Few groups drawn from themselves scatter too little: less than Student's t by the quotient of
    its quantile and the normal one, and by √((n − 1)/n). The interval includes so many more
    resamplings (Hesterberg, The American Statistician 69 (2015), 371, the expanded percentile
    interval).
    """
    if n < 2:  # all resamplings are equal: the scatter is unknown
        return 0.0, 1.0
    low = float(ndtr(np.sqrt(n / (n - 1.0)) * stdtrit(n - 1, INTERVAL_TAIL)))
    return low, 1.0 - low


def _compute_rms_um(squares: F64) -> float:
    return 1e3 * float(np.sqrt(squares.mean())) if squares.size else 0.0


def group_readings(observations: Observations) -> I64:
    """Return the group (n,) by which each reading is resampled: placement and target.

    Readings with truth are grouped by blocks of time, all copies of a posture together.
    """
    groups = observations.placement * len(observations.target_names) + observations.target
    truth = observations.has_truth
    if truth.any():
        blocks = assign_posture_folds(observations.rows(truth), TRUTH_BLOCKS)
        groups[truth] = groups.max() + 1 + blocks
    return groups


def compute_heldout_squares(current: Fit, out: Mask, arm: Arm, growth: bool = False) -> F64:
    """Return squared residuals mm² of the points left *out* (n,), under the model of the others.

    Where a calibration is given and nothing was found, the model is that calibration unchanged, not
    moved within its covariance. The first link's expansion (*growth*) predicts only where it is to
    be written: a calibration under test without that term does not have it.

    Poses, unknown seats and the lengths of links without a sensor are fitted to the held-out rests
    themselves. Errors of certified targets and the drift of the base are not: they count as error.
    An arm that a fit makes larger or smaller is scaled back.
    """
    n = 3 * len(out)
    columns_used = _list_arm_columns(current, growth)
    if current.baseline.is_given and not current.findings:
        columns_used = columns_used[columns_used >= current.layout.identified.stop]
    amplitudes = np.zeros(len(current.solution))
    amplitudes[columns_used] = current.solution[columns_used]
    predicted = current.nuisance.columns.times(amplitudes)[:n]
    for span, strange, columns in list_unknown_columns(current, out):
        fitted_columns = current.nuisance.columns.to_dense(span)[strange]
        predicted[strange] += (columns - fitted_columns) @ current.solution[span]
    residual = current.raw_residual[:n] - predicted
    # The pose is fitted to clipped residuals: a gross error must not move its whole placement.
    clipped = current.residual[:n] - predicted
    points = out & ~current.linear.rests.observations.turned
    for rests, values in current.linear.nuisance.independent_groups:
        rows = (3 * rests[points[rests]][:, None] + np.arange(3)).ravel()
        pose_columns = values[points[rests]].reshape(len(rows), values.shape[2])
        pose_columns = pose_columns[:, pose_columns.any(axis=0)]
        residual[rows] -= (
            pose_columns @ np.linalg.lstsq(pose_columns, clipped[rows], rcond=RANK_SHARE)[0]
        )
    squared_mm2: F64 = (residual.reshape(-1, 3)[points] ** 2).sum(axis=1) * compute_scale_factor(
        current, arm
    ) ** 2
    return squared_mm2


def _list_arm_columns(last: Fit, growth: bool) -> I64:
    """Return the columns whose solution holds for other placements: the arm's and the findings'."""
    layout = last.layout
    return np.concatenate(
        [
            np.arange(layout.identified.start, layout.identified.stop),
            *(np.arange(f.start, f.stop) for f in layout.findings),
            np.arange(layout.mount.start, layout.mount.stop if growth else layout.mount.start),
        ]
    )

"""Compare published points with the simulator's truth, before and after correction."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.ndimage import median_filter

from armd import Flag
from armd.arrays import F64

AROUND = 51  # points in the median of the difference of two counts

#: A record of the simulator's truth file: seq as published, true tip in the base frame.
TRUTH = np.dtype([("seq", "<u8"), ("position_mm", "<f8", (3,))])


@dataclass(frozen=True)
class PointErrors:
    """The RMS distances in µm between points and truth."""

    n: int
    before_um: float
    after_um: float
    correction_um: float  # largest

    @property
    def improvement(self) -> float:
        return self.before_um / self.after_um


def compare(points: npt.NDArray[np.void], truth: npt.NDArray[np.void]) -> PointErrors:
    """Return the errors of *points* (dtype `POINT`) against *truth* (dtype `TRUTH`), joined by seq.

    No measurement can determine how the arm's own base frame lies in the arm. So one rigid
    placement, the best fit for the corrected points, is removed from both figures.
    """
    points = points[(points["flags"] & Flag.INVALID) == 0]
    _, ours, theirs = np.intersect1d(points["seq"], truth["seq"], return_indices=True)
    after, correction = points["position_mm"][ours], points["correction_mm"][ours]
    true = truth["position_mm"][theirs]
    rotation, translation = _fit_placement(after, true)
    return PointErrors(
        n=len(ours),
        before_um=_compute_rms_um((after - correction) @ rotation.T + translation - true),
        after_um=_compute_rms_um(after @ rotation.T + translation - true),
        correction_um=float(np.linalg.norm(correction, axis=1).max()) * 1000,
    )


def load_truth(path: Path) -> npt.NDArray[np.void]:
    """Return the records written so far, without an incomplete last one."""
    data = path.read_bytes()
    return np.frombuffer(data, TRUTH, len(data) // TRUTH.itemsize)


def match_numbers(
    points: npt.NDArray[np.void], truth: npt.NDArray[np.void]
) -> npt.NDArray[np.void]:
    """Return the truth (n,) at each of *points* (n,), with their numbers.

    On CAN a latch has no number: `seq` of *truth* is its instant (CLOCK_MONOTONIC, ns). Both sides
    count SYNCs, so only the difference of the two counts is unknown. It changes only when the bus
    is lost, even if this machine is sometimes late.
    """
    instants = truth["seq"].astype(np.int64)
    seq = points["seq"].astype(np.int64)
    shift = median_filter(np.searchsorted(instants, points["monotonic_ns"]) - seq, AROUND)
    matches = np.zeros(len(points), TRUTH)
    matches["seq"] = points["seq"]
    matches["position_mm"] = truth["position_mm"][np.clip(seq + shift, 0, len(truth) - 1)]
    return matches


def match_instants(
    points: npt.NDArray[np.void], truth: npt.NDArray[np.void]
) -> npt.NDArray[np.void]:
    """Return the truth at each of *points* that lies within it, with their numbers.

    A servo has no number of a latch and samples on request: `seq` of *truth* is an instant
    (CLOCK_MONOTONIC, ns), and the tip is on the straight line between two of them.
    """
    instants, times_ns = truth["seq"].astype(np.int64), points["monotonic_ns"]
    if len(instants) == 0:
        return np.zeros(0, TRUTH)
    within = points[(times_ns >= instants[0]) & (times_ns <= instants[-1])]
    matches = np.zeros(len(within), TRUTH)
    matches["seq"] = within["seq"]
    since = instants - instants[0]
    for axis in range(3):
        matches["position_mm"][:, axis] = np.interp(
            within["monotonic_ns"] - instants[0], since, truth["position_mm"][:, axis]
        )
    return matches


def _fit_placement(points: F64, true: F64) -> tuple[F64, F64]:
    """Fit rotation (3, 3) and translation (3,) that move points (n, 3) onto true (n, 3)."""
    middle, true_middle = points.mean(axis=0), true.mean(axis=0)
    u, _, vt = np.linalg.svd((points - middle).T @ (true - true_middle))
    sign = np.sign(np.linalg.det(u @ vt))
    rotation = (u * [1.0, 1.0, sign] @ vt).T
    return rotation, true_middle - rotation @ middle


def _compute_rms_um(residuals: F64) -> float:
    return float(np.sqrt((residuals**2).sum(axis=1).mean())) * 1000

"""Compare certified lengths with those that the arm measures: they check its size."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from armd.arrays import F64
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.placements.poses import Poses

#: A length that is off by more standard uncertainties contradicts the arm.
MOST_OFF = 3.0


@dataclass(frozen=True)
class Length:
    """A certified length, and the length between its seats as the arm measures it."""

    between: tuple[str, str]
    certified_mm: float
    standard_uncertainty_mm: float  # as certified
    measured_mm: float
    measured_uncertainty_mm: float  # standard uncertainty of the measured seats, from their scatter

    @property
    def error_mm(self) -> float:
        return self.measured_mm - self.certified_mm

    @property
    def off(self) -> float:
        """The error in units of its standard uncertainty."""
        return self.error_mm / self.uncertainty_mm

    @property
    def uncertainty_mm(self) -> float:
        """The standard uncertainty of the error, of certificate and scatter together."""
        together = math.hypot(self.standard_uncertainty_mm, self.measured_uncertainty_mm)
        return max(together, 1e-9)

    def as_json(self) -> dict[str, Any]:
        """Return the object that `--json` of calibrate and evaluate contains."""
        return {"error_um": 1e3 * self.error_mm, **asdict(self), "off": self.off}

    def in_words(self) -> str:
        return (
            f"{self.between[0]} to {self.between[1]}: {self.measured_mm:.4f} mm,"
            f" certified {self.certified_mm:.4f} ± {self.standard_uncertainty_mm:.4f} mm;"
            f" off by {1e3 * self.error_mm:+.1f} µm, {self.off:+.1f} standard uncertainties"
        )


def measure_certified_lengths(
    observations: Observations, poses: Poses, residual_mm: F64, weight: F64 | None = None
) -> list[Length]:
    """Measure the certified lengths between points that were touched.

    *poses* and *residual_mm* (n, 3) are of a fit in which the lengths were not used. *weight* (n,)
    is the number of readings that each row replaces.
    """
    weight = np.ones(observations.n) if weight is None else weight
    certified = observations.distances
    is_known = np.isin(np.arange(len(poses.target_mm)), observations.target) | ~observations.unknown
    return [
        Length(
            between=(observations.target_names[a], observations.target_names[b]),
            certified_mm=float(length),
            standard_uncertainty_mm=float(u),
            measured_mm=float(np.linalg.norm(poses.target_mm[a] - poses.target_mm[b])),
            measured_uncertainty_mm=_compute_scatter_mm(observations, residual_mm, weight, (a, b)),
        )
        for (a, b), length, u in zip(
            certified.between, certified.length_mm, certified.standard_uncertainty_mm, strict=True
        )
        if is_known[a] and is_known[b]
    ]


def _compute_scatter_mm(
    observations: Observations, residual_mm: F64, weight: F64, ends: Sequence[int]
) -> float:
    """Compute the standard uncertainty of the distance between two seats from the scatter.

    Each placement gives the distance with the precision of its readings at both ends. If no
    placement holds both ends, each end counts with all its readings.
    """
    variance = np.zeros(2)
    count = np.zeros((2, len(observations.placement_names)))
    for i, end in enumerate(ends):
        rows = (observations.target == end) & ~observations.has_truth
        placement, readings = observations.placement[rows], weight[rows]
        count[i] = np.bincount(placement, readings, count.shape[1])
        freedom = max(readings.sum() - int((count[i] > 0).sum()), 1.0)
        if observations.unknown[end]:
            axes = int(observations.freedom[rows].min(initial=3))
            variance[i] = np.sum(readings[:, None] * residual_mm[rows] ** 2) / (axes * freedom)
    with np.errstate(divide="ignore", invalid="ignore"):
        variances = np.where(variance[:, None] > 0, variance[:, None] / count, 0.0).sum(axis=0)
    if not variance.any():
        return 0.0
    if np.isfinite(variances).any():
        return math.sqrt(1.0 / float(np.sum(1.0 / variances[np.isfinite(variances)])))
    return math.sqrt(float(variance @ (1.0 / np.maximum(count.sum(axis=1), 1))))

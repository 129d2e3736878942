"""Parallel planes through the positions of a tip's centre on them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64

#: The number of points on a sphere that the standard demands.
SPHERE_POINTS = 25
#: The least spread of places on a plane (RMS, mm) in both directions.
LEAST_SPREAD_MM = 2.0


@dataclass(frozen=True)
class ParallelPlanes:
    """Planes with one normal, by least squares."""

    normal: F64  # (3,)
    heights_mm: F64  # (k,) along the normal
    counts: tuple[int, ...]  # points on each
    form_mm: float  # standard deviation of the points across them
    freedom: int

    @property
    def distance_mm(self) -> float:
        """The distance of the last plane from the first."""
        return abs(float(self.heights_mm[-1] - self.heights_mm[0]))

    @property
    def apart_uncertainty_mm(self) -> float:
        """The standard uncertainty of that distance, by the scatter; NaN without freedom."""
        if not self.freedom:
            return math.nan
        return self.form_mm * math.sqrt(1 / self.counts[0] + 1 / self.counts[-1])


def fit_parallel_planes(points: Sequence[F64]) -> ParallelPlanes | None:
    """Fit planes to points (n, 3) mm on each; None where the places do not determine them."""
    counts = tuple(len(plane_points) for plane_points in points)
    if min(counts) < 1 or sum(counts) < len(points) + 2:
        return None
    off = np.concatenate([plane_points - plane_points.mean(axis=0) for plane_points in points])
    spread, directions = np.linalg.svd(off, full_matrices=False)[1:]
    if spread[1] / math.sqrt(len(off)) < LEAST_SPREAD_MM:
        return None
    freedom = len(off) - len(points) - 2
    across = float(((off @ directions[2]) ** 2).sum())
    return ParallelPlanes(
        directions[2],
        np.array([plane_points.mean(axis=0) @ directions[2] for plane_points in points]),
        counts,
        math.sqrt(across / freedom) if freedom else 0.0,
        freedom,
    )

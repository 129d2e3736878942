"""Replace readings of one kind by a few points with the same moments.

A rigid motion and an unknown point change the sum of squares of n readings only through their
number, mean and scatter. So d + 1 points in d dimensions with the same moments replace any number
of readings, exactly: least squares gives the same result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64


@dataclass
class PointMoments:
    """Number, mean (d,) and scatter about the mean (d, d) of some points."""

    n: float
    mean: F64
    scatter: F64

    def add(self, moments: PointMoments) -> None:
        """Add other points by Chan, Golub and LeVeque (1979), which avoids cancellation."""
        n = self.n + moments.n
        offset = moments.mean - self.mean
        self.scatter = (
            self.scatter + moments.scatter + np.outer(offset, offset) * (self.n * moments.n / n)
        )
        self.mean = self.mean + offset * (moments.n / n)
        self.n = n

    def points(self) -> F64:
        """Return a simplex of d + 1 points (d + 1, d) with these moments.

        Its mean is this mean, and n / (d + 1) times its scatter is this scatter.
        """
        d = len(self.mean)
        size, axes = np.linalg.eigh(self.scatter)
        corners = np.linalg.svd(np.ones((1, d + 1)))[2][1:].T  # orthonormal, about zero
        stretched = np.sqrt(np.maximum(size, 0.0) * (d + 1) / self.n)
        points: F64 = self.mean + corners @ (axes * stretched).T
        return points


def compute_moments(group: I64, points: F64) -> dict[int, PointMoments]:
    """Compute the moments of points (n, d) that share a group number."""
    if len(group) and (group == group[0]).all():  # as with a tracker that follows one point
        return {int(group[0]): _compute_moments_of_one(points)}
    groups, place, n = np.unique(group, return_inverse=True, return_counts=True)
    d, size = points.shape[1], len(groups)
    total = [np.bincount(place, points[:, i], size) for i in range(d)]
    mean = np.stack(total, axis=1) / n[:, None]
    offsets = points - mean[place]
    scatter = np.empty((size, d, d))
    for i in range(d):
        for j in range(i + 1):
            scatter[:, i, j] = np.bincount(place, offsets[:, i] * offsets[:, j], size)
            scatter[:, j, i] = scatter[:, i, j]
    return {int(groups[g]): PointMoments(float(n[g]), mean[g], scatter[g]) for g in range(size)}


def _compute_moments_of_one(points: F64) -> PointMoments:
    mean = points.mean(axis=0)
    offsets = points - mean
    return PointMoments(float(len(points)), mean, offsets.T @ offsets)

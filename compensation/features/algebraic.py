"""Fit a sphere, or in two dimensions a circle, to points by one linear system."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64

LEAST_MM = 1e-6  # of a radius


def fit_algebraic_sphere(points: F64) -> tuple[F64, float]:
    """Fit centre (d,) and radius of a sphere to points (n, d), as a start for a geometric fit.

    Least squares of |x|² = 2 c·x + (r² − c²), linear in c and the bracket (Kåsa 1976). Centre the
    points first.
    """
    design = np.column_stack([2 * points, np.ones(len(points))])
    *centre, bracket = np.linalg.lstsq(design, (points**2).sum(axis=1), rcond=None)[0]
    origin = np.array(centre)
    return origin, float(np.sqrt(max(bracket + origin @ origin, LEAST_MM**2)))

"""The sphere through points, or in two dimensions the circle, that one linear system gives."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64

LEAST_MM = 1e-6  # of a radius


def fit_algebraic_sphere(points: F64) -> tuple[F64, float]:
    """Centre (d,) and radius of |x|² = 2 c·x + (r² − c²), linear in c and the bracket, by least
    squares over points (n, d) (Kåsa 1976): where a fit of distances begins. Centre them first."""
    design = np.column_stack([2 * points, np.ones(len(points))])
    *centre, bracket = np.linalg.lstsq(design, (points**2).sum(axis=1), rcond=None)[0]
    origin = np.array(centre)
    return origin, float(np.sqrt(max(bracket + origin @ origin, LEAST_MM**2)))

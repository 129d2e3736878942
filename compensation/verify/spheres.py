"""Spheres through points: the best fitting, and the smallest that holds them all."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from armd.arrays import F64
from armd.compensation.features.algebraic import algebraic_sphere


def fit_sphere(points: F64) -> tuple[F64, float]:
    """Centre (3,) and radius of the sphere with the least squared distances to points (n, 3).

    n ≥ 4, not all in one plane (an `ArithmeticError` otherwise).
    """
    middle = points.mean(axis=0)
    around = points - middle
    if np.linalg.matrix_rank(around) < 3:
        raise ArithmeticError("the points lie in one plane")
    centre, radius = algebraic_sphere(around)

    def distances(unknown: F64) -> F64:
        out: F64 = np.linalg.norm(around - unknown[:3], axis=1) - unknown[3]
        return out

    found = least_squares(distances, [*centre, radius], xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    return middle + found[:3], float(found[3])


def smallest_sphere(points: F64) -> tuple[F64, float]:
    """Centre (3,) and radius of the smallest sphere that holds all points (n, 3), n small.

    It is determined by two, three or four of them: all such choices are tried.
    """
    if len(points) == 1:
        return points[0], 0.0
    best: tuple[F64, float] | None = None
    for size in (2, 3, 4):
        for chosen in combinations(range(len(points)), size):
            centre = _circumcentre(points[list(chosen)])
            radius = float(np.linalg.norm(points - centre, axis=1).max())
            own = float(np.linalg.norm(points[chosen[0]] - centre))
            holds = radius <= own * (1 + 1e-9) + 1e-12
            if holds and (best is None or radius < best[1]):
                best = centre, radius
    assert best is not None  # the smallest sphere touches two, three or four of its points
    return best


def _circumcentre(points: F64) -> F64:
    """The centre, within the span of two to four points, of the sphere through them."""
    edges = points[1:] - points[0]
    offset = np.linalg.lstsq(2 * edges, (edges**2).sum(axis=1), rcond=None)[0]
    centre: F64 = points[0] + offset
    return centre

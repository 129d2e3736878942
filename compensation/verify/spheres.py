"""Spheres through points: the best fit, and the smallest that contains them all."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from scipy.optimize import least_squares

from armd.arrays import F64
from armd.compensation.estimate.noise.robust import LEAST_MM
from armd.compensation.estimate.placements.fit_poses import ROBUST_ROUNDS
from armd.compensation.features.algebraic import fit_algebraic_sphere


def fit_sphere(points: F64) -> tuple[F64, float]:
    """Fit the sphere with the least squared distances to points (n, 3): centre (3,) and radius.

    n ≥ 4, not all in one plane (an `ArithmeticError` otherwise).
    """
    middle = points.mean(axis=0)
    around = points - middle
    if np.linalg.matrix_rank(around) < 3:
        raise ArithmeticError("the points lie in one plane")
    centre, radius = fit_algebraic_sphere(around)

    def distances(unknown: F64) -> F64:
        out: F64 = np.linalg.norm(around - unknown[:3], axis=1) - unknown[3]
        return out

    solution = least_squares(distances, [*centre, radius], xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    return middle + solution[:3], float(solution[3])


def measure_distances_from_sphere(points: F64, radius: float) -> F64:
    """Measure distances (n,) of points (n, 3) from a sphere of this radius, fitted robustly.

    Each point is left out once. From the fit with the least residuals, all points are weighted by
    Cauchy's weights.
    """
    numbers = np.arange(len(points))
    centres = [_fit_centre(points[numbers != i], radius, np.ones(len(points) - 1)) for i in numbers]
    squares = [
        np.sum(_measure_outside(points[numbers != i], centre, radius) ** 2)
        for i, centre in enumerate(centres)
    ]
    off = np.abs(_measure_outside(points, centres[int(np.argmin(squares))], radius))
    for _ in range(ROBUST_ROUNDS):
        weight = 1.0 / (1.0 + (off / max(float(np.median(off)), LEAST_MM)) ** 2)
        off = np.abs(_measure_outside(points, _fit_centre(points, radius, weight), radius))
    return off


def _fit_centre(points: F64, radius: float, weight: F64) -> F64:
    """Fit the centre (3,) of the sphere of this *radius* with the least *weight*ed squares."""

    def off(centre: F64) -> F64:
        return np.sqrt(weight) * _measure_outside(points, centre, radius)

    solution: F64 = least_squares(off, np.median(points, axis=0)).x
    return solution


def _measure_outside(points: F64, centre: F64, radius: float) -> F64:
    outside: F64 = np.linalg.norm(points - centre, axis=1) - radius
    return outside


def find_smallest_sphere(points: F64) -> tuple[F64, float]:
    """Find centre (3,) and radius of the smallest sphere that contains all points (n, 3), n small.

    It is determined by two, three or four of them: all such choices are tried.
    """
    if len(points) == 1:
        return points[0], 0.0
    best: tuple[F64, float] | None = None
    for size in (2, 3, 4):
        for chosen in combinations(range(len(points)), size):
            centre = _compute_circumcentre(points[list(chosen)])
            radius = float(np.linalg.norm(points - centre, axis=1).max())
            own_radius = float(np.linalg.norm(points[chosen[0]] - centre))
            holds = radius <= own_radius * (1 + 1e-9) + 1e-12
            if holds and (best is None or radius < best[1]):
                best = centre, radius
    assert best is not None  # the smallest sphere touches two, three or four of its points
    return best


def _compute_circumcentre(points: F64) -> F64:
    """Compute the centre, within the span of two to four points, of the sphere through them."""
    edges = points[1:] - points[0]
    offset = np.linalg.lstsq(2 * edges, (edges**2).sum(axis=1), rcond=None)[0]
    centre: F64 = points[0] + offset
    return centre

"""Starting values for the fits of shapes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armd.arrays import F64
from armd.compensation.features.algebraic import fit_algebraic_sphere
from armd.compensation.features.shapes import Shape, Start, find_across

#: Directions over the half sphere that are tried for a cylinder's axis. Starts within about 15° of
#: the axis converge; 120 directions leave no wider gap.
AXES = 120

REFINED = 4


def _principal(x: F64) -> F64:
    """Return unit vectors (3, 3) as rows, that of the largest extent first; *x* is centred."""
    vectors: F64 = np.linalg.svd(x, full_matrices=True)[2]
    return vectors


def _flat_circle(x: F64, normal: F64) -> tuple[Start, float]:
    """Fit a circle to points seen along *normal*; also return its mean square."""
    e1, e2 = find_across(normal)
    flat = np.stack([x @ e1, x @ e2], axis=1)
    (c1, c2), radius = fit_algebraic_sphere(flat)
    off = np.linalg.norm(flat - [c1, c2], axis=1) - radius
    return Start(c1 * e1 + c2 * e2, normal, radius), float(np.mean(off**2))


def _start_sphere(x: F64) -> list[Start]:
    centre, radius = fit_algebraic_sphere(x)
    return [Start(centre, np.array([0.0, 0.0, 1.0]), radius)]


def _start_cylinder(x: F64) -> list[Start]:
    """Return starts along the directions in which the points look most like a circle."""
    i = np.arange(AXES) + 0.5
    up, around = i / AXES, np.pi * (1 + np.sqrt(5.0)) * i  # a spiral over the half sphere
    level = np.sqrt(1 - up**2)
    spiral = np.stack([level * np.cos(around), level * np.sin(around), up], axis=1)
    tried = [_flat_circle(x, direction) for direction in np.vstack([_principal(x), spiral])]
    return [start for start, _ in sorted(tried, key=lambda pair: pair[1])[:REFINED]]


STARTS: dict[Shape, Callable[[F64], list[Start]]] = {
    "point": lambda x: [Start(np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.0)],
    "line": lambda x: [Start(np.zeros(3), _principal(x)[0], 0.0)],
    "plane": lambda x: [Start(np.zeros(3), _principal(x)[2], 0.0)],
    "circle": lambda x: [_flat_circle(x, _principal(x)[2])[0]],
    "sphere": _start_sphere,
    "cylinder": _start_cylinder,
}

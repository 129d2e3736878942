"""How the points on a surface scatter about it, as far as the readings of a placement tell."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.data.session_format import SurfaceKind
from armd.compensation.verify.spheres import fit_sphere
from armd.compensation.verify.touched import fit_parallel_planes

#: Points beyond its unknowns that a surface wants before its scatter is told.
SPARE = 2
UNKNOWNS: dict[SurfaceKind, int] = {"plane": 3, "sphere": 4}


def compute_surface_residuals(kind: SurfaceKind, points_mm: F64) -> tuple[F64, int] | None:
    """Distances (n,) mm of points (n, 3) from the best surface, and how many unknowns it took; None
    for too few points, and of a cylinder."""
    unknowns = UNKNOWNS.get(kind)
    if unknowns is None or len(points_mm) < unknowns + SPARE:
        return None
    if kind == "sphere":
        try:
            centre, radius = fit_sphere(points_mm)
        except ArithmeticError:
            return None
        return np.linalg.norm(points_mm - centre, axis=1) - radius, unknowns
    planes = fit_parallel_planes([points_mm])
    if planes is None:
        return None
    return (points_mm - points_mm.mean(axis=0)) @ planes.normal, unknowns

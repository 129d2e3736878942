"""Figures of an arm from points on spheres and planes: size, form, and distances of two faces."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.data.sessions.format import Artefact
from armd.compensation.verify.spheres import fit_sphere
from armd.compensation.verify.touched import fit_parallel_planes

Groups = dict[tuple[str, str], F64]  # (placement, target) → (n, 3) mm

#: The fewest points from which a form is computed; a sphere has four unknowns, a plane three.
SPHERE_POINTS, PLANE_POINTS = 6, 5


@dataclass(frozen=True)
class PointFigure:
    """A figure of one check; a spread is a standard deviation with *freedom* degrees of freedom."""

    name: str
    value_mm: float
    own_mm: float = math.nan  # its standard uncertainty from the scatter inside the check
    freedom: int = 0  # only for a spread
    longest_mm: float = 0.0  # for a certified length: the length

    @property
    def is_spread(self) -> bool:
        return self.freedom > 0


def compute_surface_figures(
    artefact: Artefact, groups: Groups, tip_radius_mm: float
) -> Iterator[PointFigure]:
    """Compute figures of the artefact's spheres and planes from the points of each placement."""
    for surface in artefact.surfaces:
        for (placement, target), positions in groups.items():
            if target != surface.name:
                continue
            name = _name_in_placement(target, placement)
            if surface.kind == "sphere":
                yield from compute_sphere_figures(
                    name, positions, 2 * (surface.radius_mm or 0.0), tip_radius_mm
                )
            elif surface.kind == "plane" and len(positions) >= PLANE_POINTS:
                planes = fit_parallel_planes([positions])
                if planes is not None:
                    yield PointFigure(f"form {name}", planes.form_mm, freedom=planes.freedom)
    yield from _measure_blocks(artefact, groups, tip_radius_mm)


def compute_sphere_figures(
    name: str, on: F64, diameter_mm: float, tip_radius_mm: float
) -> Iterator[PointFigure]:
    """Compute size and form of a sphere from tip centres (n, 3) *on* it; none from too
    few points.
    """
    if len(on) < SPHERE_POINTS:
        return
    try:
        centre, radius = fit_sphere(on)
    except ArithmeticError:
        return
    offset_mm = on - centre
    distance = np.linalg.norm(offset_mm, axis=1)
    freedom = len(on) - 4
    form = math.sqrt(float(((distance - radius) ** 2).sum()) / freedom)
    jacobian = np.column_stack([offset_mm / distance[:, None], np.ones(len(on))])
    deviation = form * math.sqrt(float(np.linalg.inv(jacobian.T @ jacobian)[3, 3]))
    yield PointFigure(f"size {name}", 2 * (radius - tip_radius_mm) - diameter_mm, 2 * deviation)
    yield PointFigure(f"form {name}", form, freedom=freedom)


def _measure_blocks(
    artefact: Artefact, groups: Groups, tip_radius_mm: float
) -> Iterator[PointFigure]:
    """Measure the error of each certified length between two planes that were touched
    from outside.
    """
    kinds = artefact.surface_kinds
    for distance in artefact.distances:
        first, second = distance.between
        if kinds.get(first) != "plane" or kinds.get(second) != "plane":
            continue
        for placement in [place for place, name in groups if name == first]:
            if (placement, second) not in groups:
                continue
            planes = fit_parallel_planes([groups[placement, name] for name in distance.between])
            if planes is None:
                continue
            error = planes.distance_mm - 2 * tip_radius_mm - distance.length_mm
            name = _name_in_placement(f"{first} to {second}", placement)
            deviation = planes.apart_uncertainty_mm
            yield PointFigure(f"length {name}", error, deviation, longest_mm=distance.length_mm)


def _name_in_placement(name: str, placement: str) -> str:
    return name if placement == "1" else f"{name} in {placement}"

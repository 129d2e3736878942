"""Stations on surfaces, each touched anywhere and often enough to locate it."""

from __future__ import annotations

from collections.abc import Sequence

from armd.compensation.data.sessions.format import Artefact, SurfaceKind
from armd.compensation.verify.touched import SPHERE_POINTS
from armd.daemon.measure.plan.stations import PLACES, Station

#: Touches of a surface in each placement for a calibration: each gives one number, not a point.
CALIBRATION_TOUCHES = 40
#: Placements of an artefact of surfaces alone; positions of a verified sphere; touches of a face.
SURFACE_PLACEMENTS, SPHERE_POSITIONS, FACE_TOUCHES = len(PLACES), 2, 8

HOW: dict[SurfaceKind, str] = {
    "plane": "touch the face anywhere, far from the last place, the shaft outside of it",
    "sphere": "touch the sphere anywhere on the half within reach, far from the last place",
    "cylinder": "touch the cylinder anywhere around and along it, far from the last place",
}


def make_surface_stations(
    artefact: Artefact, placement: str, names: Sequence[str], touches: int
) -> list[Station]:
    """Return stations on the surfaces among *names* in one placement, in turn."""
    kinds = artefact.surface_kinds
    return [
        Station(placement=placement, target=name, how=HOW[kinds[name]])
        for _ in range(touches)
        for name in names
        if name in kinds
    ]


def list_verified_surfaces(artefact: Artefact) -> list[Station]:
    """Return the stations that `armd verify` uses.

    They are on each sphere in two positions, and on the faces of each block.
    """
    spheres = [surface.name for surface in artefact.surfaces if surface.kind == "sphere"]
    stations = [
        station
        for position in range(1, SPHERE_POSITIONS + 1)
        for station in make_surface_stations(artefact, f"SPHERE{position}", spheres, SPHERE_POINTS)
    ]
    planes = {surface.name for surface in artefact.surfaces if surface.kind == "plane"}
    blocks = [d.between for d in artefact.distances if planes.issuperset(d.between)]
    for number, faces in enumerate(blocks, 1):
        stations += make_surface_stations(artefact, f"BLOCK{number}", faces, FACE_TOUCHES)
    return stations

"""Single readings of a verification that lie far from where the others of their test place them.

They are told and counted: a verification judges all that was measured. Whoever pressed the button
in the air learns of which reading that was; whether it may be taken again, the standard says.

No arm or artefact is fitted for it: a bar says nothing of a turn about itself, nor one seat of any.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.data.sessions.format import Distance
from armd.compensation.data.sessions.session import Session
from armd.compensation.identify.admission.far_off import FarOff, find_far_readings
from armd.compensation.verify.spheres import measure_distances_from_sphere

#: Targets that are points on one sphere, if they are of one placement. The sphere of L_Dia stands
#: still while the arm's posture changes, and so does that of the effective diameter.
ON_SPHERE = re.compile(r"(SPHERE[12]|LDIA|EFFDIA)\.")
#: Of five points, a pole and four on the equator, one left out says nothing: the others hardly tell
#: how high the sphere is. Of nine it does.
LEAST_POINTS = 9
#: Of so many readings of one seat, the middle one is at it though one of them is not.
LEAST_REPEATS = 3


def check_repeats(session: Session, position_mm: F64) -> FarOff:
    """Readings of a seat, whose tips stand at *position_mm* (n, 3), far from the middle one."""
    off_mm = np.full(session.n, np.nan)
    for rows in _iterate_seats(session, position_mm):
        if len(rows) >= LEAST_REPEATS:
            points = position_mm[rows]
            off_mm[rows] = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    return find_far_readings(off_mm)


def check_lengths(
    session: Session, position_mm: F64, length_mm: Callable[[Distance, str], float]
) -> FarOff:
    """Readings of the ends of a certified length that is farther off than the others; both ends
    are told, because one reading each does not say which. *length_mm*: at a placement."""
    names, off_mm = session.artefact.target_names, np.full(session.n, np.nan)
    rows_by_seat = {
        (names[session.target[rows[0]]], int(session.placement[rows[0]])): rows
        for rows in _iterate_seats(session, position_mm)
        if len(rows) < LEAST_REPEATS
    }
    for distance in session.artefact.distances:
        for number, placement in enumerate(session.placement_names):
            end_rows = [rows_by_seat.get((name, number)) for name in distance.between]
            if end_rows[0] is None or end_rows[1] is None:
                continue
            difference_mm = position_mm[end_rows[1]].mean(axis=0) - position_mm[end_rows[0]].mean(
                axis=0
            )
            error = abs(float(np.linalg.norm(difference_mm)) - length_mm(distance, placement))
            off_mm[np.concatenate([end_rows[0], end_rows[1]])] = error
    return find_far_readings(off_mm)


def check_spheres(session: Session, position_mm: F64, radius_mm: float) -> FarOff:
    """Points far from the sphere of this radius, tip included, that the others of it are on."""
    names, off_mm = session.artefact.target_names, np.full(session.n, np.nan)
    spheres = [match[1] if (match := ON_SPHERE.match(name)) else "" for name in names]
    sphere, usable = np.array(spheres)[session.target], np.isfinite(position_mm).all(axis=1)
    for group in sorted(set(spheres) - {""}):
        for placement in range(len(session.placement_names)):
            rows = np.flatnonzero((sphere == group) & (session.placement == placement) & usable)
            if len(rows) >= LEAST_POINTS:
                off_mm[rows] = measure_distances_from_sphere(position_mm[rows], radius_mm)
    return find_far_readings(off_mm)


def check_surfaces(session: Session, position_mm: F64, radii_mm: Mapping[str, float]) -> FarOff:
    """The same of spheres that are surfaces, by the name and the radius of each, tip included."""
    names, off_mm = session.artefact.target_names, np.full(session.n, np.nan)
    usable = np.isfinite(position_mm).all(axis=1)
    for name, radius_mm in radii_mm.items():
        for placement in range(len(session.placement_names)):
            is_on_surface = (
                (session.target == names.index(name)) & (session.placement == placement) & usable
            )
            if (rows := np.flatnonzero(is_on_surface)).size >= LEAST_POINTS:
                off_mm[rows] = measure_distances_from_sphere(position_mm[rows], radius_mm)
    return find_far_readings(off_mm)


def _iterate_seats(session: Session, position_mm: F64) -> Iterator[I64]:
    """The readings of each seat in each placement, where it is no surface or point on a sphere."""
    usable = np.isfinite(position_mm).all(axis=1)
    surfaces = session.artefact.surface_kinds
    for target, name in enumerate(session.artefact.target_names):
        for placement in range(len(session.placement_names)):
            is_at_seat = (session.target == target) & (session.placement == placement) & usable
            if is_at_seat.any() and name not in surfaces and not ON_SPHERE.match(name):
                yield np.flatnonzero(is_at_seat)

"""Find single readings of a verification far from where the others of their test place them.

They are reported and still used, because a verification judges all that was measured. A user who
pressed the button in the air learns which reading it was. The standard states whether it may be
taken again. No arm or artefact is fitted for this: a bar does not determine its turn about itself,
and one seat determines no turn at all.
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

#: Targets that are points on one sphere, within one placement. The sphere of L_Dia stands still
#: while the arm's posture changes, and so does that of the effective diameter.
ON_SPHERE = re.compile(r"(SPHERE[12]|LDIA|EFFDIA)\.")
#: With five points, a pole and four on the equator, leaving one out shows nothing: the others
#: hardly determine the sphere's height. With nine points it does.
LEAST_POINTS = 9
#: With this many readings of one seat, the median is at the seat even if one of them is not.
LEAST_REPEATS = 3


def check_repeats(session: Session, position_mm: F64) -> FarOff:
    """Find readings of a seat, with tips at *position_mm* (n, 3), far from their median."""
    off_mm = np.full(session.n, np.nan)
    for rows in _iterate_seats(session, position_mm):
        if len(rows) >= LEAST_REPEATS:
            points = position_mm[rows]
            off_mm[rows] = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    return find_far_readings(off_mm)


def check_lengths(
    session: Session, position_mm: F64, length_mm: Callable[[Distance, str], float]
) -> FarOff:
    """Find readings of the ends of a certified length with a larger error than the others.

    Both ends are reported, because one reading each does not show which is wrong. *length_mm*: the
    certified length in a placement.
    """
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
    """Find points far from the sphere of this radius, tip included, on which the others lie."""
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
    """Find points far from spheres that are surfaces; see `check_spheres`.

    *radii_mm* has the radius, tip included, of each by name.
    """
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
    """Yield the readings of each seat in each placement, without surfaces and points on spheres."""
    usable = np.isfinite(position_mm).all(axis=1)
    surfaces = session.artefact.surface_kinds
    for target, name in enumerate(session.artefact.target_names):
        for placement in range(len(session.placement_names)):
            is_at_seat = (session.target == target) & (session.placement == placement) & usable
            if is_at_seat.any() and name not in surfaces and not ON_SPHERE.match(name):
                yield np.flatnonzero(is_at_seat)

"""Refuse surfaces that were touched at too few places, or places too close, to locate them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.data.sessions.session import Session
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.placements.poses import Poses
from armd.compensation.estimate.surface_kinds import CYLINDER, FREEDOM, PLANE
from armd.compensation.estimate.surfaces import LEAST_COSINE, compute_mean_cosines
from armd.errors import BadInput
from armd.terminal.counted import format_count

#: The least spread (RMS, mm) of places on a plane in its narrower direction, and along a cylinder.
#: Under the nominal geometry, one spot touched from many sides seems to spread by half of it.
LEAST_SPREAD_MM = 2.0
#: Places that spread by less than this (mm) also count as one spot if they lie in a cloud and not
#: in a plane: if they leave the plane by half as much. A bad nominal geometry makes a cloud of a
#: spot.
SPOT_MM = 5.0
#: The least spread (RMS) of a sphere's normals in each of two directions: normals of a cap of 25°
#: about its pole reach it. Around a cylinder those of an arc of 50° do.
LEAST_TURN = 0.2
#: With a smaller part of the shaft along the normals, the side that was touched is undetermined.
LEAST_SHAFT = 0.05


def require_surfaces(
    sessions: Sequence[Session], observations: Observations, poses: Poses, position_mm: F64
) -> None:
    """Raise `BadInput` for a surface that its readings do not locate.

    *poses* and *position_mm* (n, 3), base frame, may be of any model that is near enough.
    """
    if not observations.on_surface.any():
        return
    normal = poses.compute_normals(observations, position_mm)
    every = np.flatnonzero(observations.on_surface)
    of_placement = observations.placement[every]
    for p in np.unique(of_placement):
        rows = every[of_placement == p]
        kind = int(observations.kind[observations.target[rows[0]]])
        if fault := _find_fault(observations, rows, kind, position_mm[rows], normal[rows]):
            raise _make_refusal(sessions, observations, rows, *fault)
    for k in np.unique(observations.target[every]):
        rows = every[observations.target[every] == k]
        if _needs_side(observations, int(k)) and (
            fault := _find_missing_side(observations, rows, normal[rows])
        ):
            raise _make_refusal(sessions, observations, rows, *fault)


def _find_fault(
    observations: Observations, rows: I64, kind: int, position: F64, normal: F64
) -> tuple[str, str] | None:
    """Return what was found and expected if readings *rows* (m,) do not locate a surface."""
    target = observations.target[rows]
    parts = [target == k for k in np.unique(target)]
    n_needed = FREEDOM[kind] + int(kind == CYLINDER) + len(parts) - 1
    n_needed += int(kind != PLANE and observations.unknown[target[0]])
    if len(rows) < n_needed:
        return format_count(len(rows), "reading"), f"at least {n_needed} on this surface"
    if kind == PLANE:
        off = np.concatenate([position[part] - position[part].mean(axis=0) for part in parts])
        wide, narrow, thin = _compute_spread(off)
        if narrow < LEAST_SPREAD_MM or (narrow < SPOT_MM and thin > 0.5 * narrow):
            place = "at one spot" if wide < SPOT_MM else "along one line"
            problem = f"a plane touched {place} ({wide:.2g} mm × {narrow:.2g} mm RMS)"
            return problem, f"places that spread by {LEAST_SPREAD_MM:g} mm RMS in both directions"
        return None
    turned = _compute_spread(normal - normal.mean(axis=0))
    if kind == CYLINDER:
        axis = np.linalg.svd(normal)[2][2]
        off = position - position.mean(axis=0)
        thin, across = float(_compute_spread(off)[2]), np.linalg.svd(off)[2][2]
        # One circle also lies on cylinders that are inclined to it.
        along = thin if abs(axis @ across) > np.sqrt(0.5) else float(np.std(position @ axis))
        if along < LEAST_SPREAD_MM:
            problem = f"a cylinder touched around one circle ({along:.2g} mm RMS along it)"
            return problem, f"places that spread by {LEAST_SPREAD_MM:g} mm RMS along it"
        if turned[0] < LEAST_TURN:
            return "a cylinder touched along one line", "places around it"
        return None
    if turned[1] < LEAST_TURN:
        widest = np.degrees(np.arccos(np.clip(normal @ normal.T, -1.0, 1.0))).max()
        problem = f"a sphere touched on one cap or arc (normals within {widest:.0f}°)"
        return problem, "places all over the half that is within reach"
    return None


def _needs_side(observations: Observations, target: int) -> bool:
    """Return whether it matters on which side of a surface the tip's radius lies."""
    tied = bool(np.isin(target, observations.distances.between))
    return tied or (observations.kind[target] != PLANE and not observations.unknown[target])


def _find_missing_side(
    observations: Observations, rows: I64, normal: F64
) -> tuple[str, str] | None:
    approach, shaft = compute_mean_cosines(observations, rows, normal)
    if abs(approach) >= LEAST_COSINE or abs(shaft) >= LEAST_SHAFT:
        return None
    return (
        "a shaft along the surface, on neither side of it",
        "approach_x, approach_y, approach_z, which say from which side it was touched",
    )


def _compute_spread(points: F64) -> F64:
    """Return the RMS (3,) of centred points (n, 3) along their principal directions, descending."""
    spread: F64 = np.linalg.svd(points, compute_uv=False) / np.sqrt(len(points))
    return np.append(spread, np.zeros(3))[:3]


def _make_refusal(
    sessions: Sequence[Session], observations: Observations, rows: I64, problem: str, expected: str
) -> BadInput:
    i = int(rows[0])
    placement = observations.placement_names[observations.placement[i]].rpartition("/")[2]
    names = [observations.target_names[k] for k in np.unique(observations.target[rows])]
    surface_names = " and ".join(name.rpartition("/")[2] for name in names)
    session = sessions[int(observations.session[i])]
    return BadInput(
        session.path, f"surface {surface_names}, placement {placement}", problem, expected
    )

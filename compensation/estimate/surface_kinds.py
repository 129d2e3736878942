"""Surfaces among an artefact's targets, each in a placement of its own.

In each placement of the artefact a surface's position is unknown and independent of all else there.
So its readings have a placement of their own, in whose frame the surface is fixed: a plane at a
height, a sphere about the origin, a cylinder about z. Motions of a placement that do not move the
surface (a turn about a sphere's centre) are not identifiable, and the fit does not count them.
"""

from __future__ import annotations

import numpy as np

from armd.arrays import I64
from armd.compensation.data.sessions.format import Artefact, SurfaceKind
from armd.compensation.data.sessions.session import Session

#: Kinds of a target; TURN is the orientation of a body on the last link.
POINT, PLANE, SPHERE, CYLINDER, TURN = range(5)
_KINDS: dict[SurfaceKind, int] = {"plane": PLANE, "sphere": SPHERE, "cylinder": CYLINDER}
#: Number of a placement's directions that move a target of each kind.
FREEDOM = {POINT: 6, PLANE: 3, SPHERE: 3, CYLINDER: 4}


def list_kinds(artefact: Artefact) -> I64:
    """Return the kind (K,) of each target of *artefact*."""
    kinds = [_KINDS[surface.kind] for surface in artefact.surfaces]
    return np.array([POINT] * len(artefact.targets) + kinds, dtype=np.int64)


def list_placements(session: Session) -> tuple[list[str], I64]:
    """Return the names of a session's placements, and each reading's placement (n,).

    Each surface has a placement of its own wherever it was touched, beside those of the session;
    parallel planes tied by certified lengths share it. It has the name of the session's placement.
    """
    if not session.artefact.surfaces:
        return session.placement_names, session.placement
    body = _group_bodies(session.artefact)[session.target]
    body = np.where(np.isfinite(session.truth_mm[:, 0]), -1, body)
    pairs, pair_index = np.unique(
        np.stack([session.placement, body], axis=1), axis=0, return_inverse=True
    )
    number = np.empty(len(pairs), dtype=np.int64)
    surfaces = pairs[:, 1] >= 0
    names = session.placement_names
    number[~surfaces] = pairs[~surfaces, 0]
    number[surfaces] = len(names) + np.arange(int(surfaces.sum()))
    return [*names, *(names[p] for p in pairs[surfaces, 0])], number[pair_index.reshape(-1)]


def _group_bodies(artefact: Artefact) -> I64:
    """Return for each target (K,) the first surface to which it is tied; -1 for a point."""
    names = artefact.target_names
    body = np.where(list_kinds(artefact) == POINT, -1, np.arange(len(names)))
    for distance in artefact.distances:
        first_body, second_body = body[[names.index(name) for name in distance.between]]
        body[(body == max(first_body, second_body)) & (body >= 0)] = min(first_body, second_body)
    return body

"""Find the names of an artefact's targets if they are counted from another of its ends.

A beam turned end for end, or a plate turned by a half or a quarter turn, lies nearly as before.
Everything looks right; only the small differences between its spacings show the turn.
"""

from __future__ import annotations

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.estimate.placements.rigid_motions import fit_by_kabsch

#: A turned target matches another one within this share of the least spacing.
NEAR_SHARE = 0.25


def find_renumberings(points_mm: F64) -> list[I64]:
    """Find the turns that bring *points_mm* (k, 3) near themselves.

    Return for each turn the index (k,) of the point on which each point then lies. Turns that move
    no more than two points, such as exchanges of two, are skipped.
    """
    apart_mm = np.linalg.norm(points_mm[:, None] - points_mm, axis=2)
    near_mm = NEAR_SHARE * np.min(
        apart_mm + np.diag(np.full(len(points_mm), np.inf)), initial=np.inf
    )
    if len(points_mm) < 3 or near_mm == 0.0:
        return []
    three = _choose_far_points(points_mm, apart_mm)
    renumberings: dict[tuple[int, ...], I64] = {}
    for images in _find_same_triangles(apart_mm, three, 2.0 * near_mm):
        everything, once = np.ones(3), np.zeros(3, dtype=np.int64)
        turn, shift = fit_by_kabsch(points_mm[three], points_mm[images], everything, once, 1)
        turned_mm = points_mm @ turn[0].T + shift[0]
        distance_mm = np.linalg.norm(turned_mm[:, None] - points_mm, axis=2)
        onto = distance_mm.argmin(axis=1)
        moved = int((onto != np.arange(len(onto))).sum())
        if distance_mm.min(axis=1).max() < near_mm and len(set(onto)) == len(onto) and moved > 2:
            renumberings[tuple(onto)] = onto
    return list(renumberings.values())


def _choose_far_points(points_mm: F64, apart_mm: F64) -> I64:
    """Return the two points farthest apart, and the point farthest from the line through them."""
    a, b = np.unravel_index(int(apart_mm.argmax()), apart_mm.shape)
    along = (points_mm[b] - points_mm[a]) / apart_mm[a, b]
    aside_mm = np.linalg.norm(np.cross(points_mm - points_mm[a], along), axis=1)
    aside_mm[[a, b]] = -1.0
    return np.array([a, b, aside_mm.argmax()])


def _find_same_triangles(apart_mm: F64, three: I64, within_mm: float) -> I64:
    """Return all ordered triples (m, 3) with the distances of *three* to within *within_mm*."""
    a, b, c = three
    first = np.argwhere(np.abs(apart_mm - apart_mm[a, b]) < within_mm)
    rows = [
        np.column_stack([np.tile(pair, (len(thirds), 1)), thirds])
        for pair in first
        if len(
            thirds := np.flatnonzero(
                (np.abs(apart_mm[pair[0]] - apart_mm[a, c]) < within_mm)
                & (np.abs(apart_mm[pair[1]] - apart_mm[b, c]) < within_mm)
            )
        )
    ]
    return np.concatenate(rows) if rows else np.empty((0, 3), dtype=np.int64)

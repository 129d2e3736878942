"""Places a session's artefact: rigid poses and unknown points, fitted to the twin's tips.

The accuracy hardly matters, because the twin's readings are then made to fit exactly.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64, Mask

SWEEPS = 60
#: Newton steps that bring unknown points to their certified lengths.
STEPS = 20


@dataclass(frozen=True)
class TouchedRows:
    """The targets of n rows: the tip was at `target` of `placement`, or at `truth_mm` there."""

    placement: I64  # (n,)
    target: I64  # (n,)
    truth_mm: F64  # (n, 3) NaN where `target` is used
    stretch: F64  # (n,) the artefact's size relative to its certificate

    def local_mm(self, target_mm: F64) -> F64:
        """Return the points (n, 3) in the placement's frame, of targets (K, 3).

        NaN where not known.
        """
        points = self.stretch[:, None] * target_mm[self.target]
        return np.where(np.isfinite(self.truth_mm[:, :1]), self.truth_mm, points)


@dataclass(frozen=True)
class CertifiedDistance:
    """A certified length between two targets."""

    between: tuple[int, int]
    length_mm: float


def find_goals(
    touched: TouchedRows, target_mm: F64, lengths: Sequence[CertifiedDistance], tip_mm: F64
) -> F64:
    """Find the wanted tip positions (n, 3), base frame, nearest to *tip_mm* (n, 3).

    *target_mm* (K, 3) are certified positions, NaN for an unknown point. Rows whose tip is not
    known (NaN) are not used, and their result is NaN.
    """
    used = np.isfinite(tip_mm[:, 0])
    unknown = np.isnan(target_mm[:, 0])
    rotation, origin, target_mm = _begin(touched, target_mm.copy(), tip_mm, used)
    for _ in range(SWEEPS if unknown.any() else 1):
        _move_points(touched, target_mm, unknown, (rotation, origin), tip_mm, used)
        _place_all(touched, target_mm, (rotation, origin), tip_mm, used)
    if lengths and unknown.any():
        _keep_lengths(target_mm, unknown, lengths)
        _place_all(touched, target_mm, (rotation, origin), tip_mm, used)
    local = touched.local_mm(target_mm)
    placed = np.einsum("nij,nj->ni", rotation[touched.placement], local)
    return np.where(used[:, None], placed + origin[touched.placement], np.nan)


def fit_rigid_motion(local_mm: F64, base_mm: F64) -> tuple[F64, F64]:
    """Fit rotation (3, 3) and origin (3,) that bring points (n, 3) nearest to others (Kabsch)."""
    middle, base_middle = local_mm.mean(axis=0), base_mm.mean(axis=0)
    u, _, vt = np.linalg.svd((base_mm - base_middle).T @ (local_mm - middle))
    mirrored = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation: F64 = u @ mirrored @ vt
    return rotation, base_middle - rotation @ middle


def _begin(touched: TouchedRows, target_mm: F64, tip_mm: F64, used: Mask) -> tuple[F64, F64, F64]:
    """Return first poses, those with most known points first, and target positions.

    Each pose determines further unknown points.
    """
    count = int(touched.placement.max()) + 1
    rotation, origin = np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    unplaced = set(np.unique(touched.placement[used]).tolist())
    while unplaced:
        has_target = used & np.isfinite(touched.local_mm(target_mm)[:, 0])
        rows = {p: np.flatnonzero(has_target & (touched.placement == p)) for p in unplaced}
        distinct = {
            p: len(np.unique(touched.local_mm(target_mm)[placement_rows].round(6), axis=0))
            for p, placement_rows in rows.items()
        }
        chosen = max(sorted(unplaced), key=distinct.__getitem__)
        placement_rows = rows[chosen]
        if len(placement_rows):
            local = touched.local_mm(target_mm)[placement_rows]
            rotation[chosen], origin[chosen] = fit_rigid_motion(local, tip_mm[placement_rows])
        unplaced.remove(chosen)
        for k in np.unique(touched.target[used & (touched.placement == chosen)]):
            if np.isnan(target_mm[k, 0]):
                touching_rows = used & (touched.placement == chosen) & (touched.target == k)
                target_mm[k] = ((tip_mm[touching_rows] - origin[chosen]) @ rotation[chosen]).mean(
                    axis=0
                )
    target_mm[np.isnan(target_mm)] = 0.0  # never touched
    return rotation, origin, target_mm


def _move_points(
    touched: TouchedRows,
    target_mm: F64,
    unknown: Mask,
    poses: tuple[F64, F64],
    tip_mm: F64,
    used: Mask,
) -> None:
    """Move unknown points to the mean of their positions by the tips."""
    rotation, origin = poses
    away = tip_mm - origin[touched.placement]
    local = np.einsum("nji,nj->ni", rotation[touched.placement], away) / touched.stretch[:, None]
    by_target = used & np.isnan(touched.truth_mm[:, 0]) & unknown[touched.target]
    for k in np.unique(touched.target[by_target]):
        target_mm[k] = local[by_target & (touched.target == k)].mean(axis=0)


def _place_all(
    touched: TouchedRows, target_mm: F64, poses: tuple[F64, F64], tip_mm: F64, used: Mask
) -> None:
    rotation, origin = poses
    local = touched.local_mm(target_mm)
    for p in np.unique(touched.placement[used]):
        placement_rows = used & (touched.placement == p)
        rotation[p], origin[p] = fit_rigid_motion(local[placement_rows], tip_mm[placement_rows])


def _keep_lengths(target_mm: F64, unknown: Mask, lengths: Sequence[CertifiedDistance]) -> None:
    """Move unknown points as little as possible until certified lengths are kept."""
    ends = np.array([length.between for length in lengths])
    certified_mm = np.array([length.length_mm for length in lengths])
    for _ in range(STEPS):
        difference_mm = target_mm[ends[:, 0]] - target_mm[ends[:, 1]]
        apart_mm = np.linalg.norm(difference_mm, axis=1)
        unit = difference_mm / np.maximum(apart_mm, 1e-9)[:, None]
        slope = np.zeros((len(lengths), *target_mm.shape))
        for i, (first, second) in enumerate(ends):
            slope[i, first] += unit[i]
            slope[i, second] -= unit[i]
        slope[:, ~unknown] = 0.0
        step = np.linalg.pinv(slope.reshape(len(lengths), -1)) @ (certified_mm - apart_mm)
        target_mm += step.reshape(target_mm.shape)

"""Rigid motions that map groups of points to their images: least squares in closed form."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64, I64


def fit_by_kabsch(
    points: F64, images: F64, weight: F64, group: I64, n_groups: int
) -> tuple[F64, F64]:
    """Return rigid motions (G, 3, 3), (G, 3) that map points (n, 3) to images, group by group.

    Weighted least squares (Kabsch, Acta Cryst. A32, 1976). Rows with NaN points are dropped; a
    group with too few points gets one of the motions that fit.
    """
    is_known = np.isfinite(points[:, 0])
    points, images, group = points[is_known], images[is_known], group[is_known]
    weight = weight[is_known, None]
    total = np.maximum(np.bincount(group, weight[:, 0], n_groups), 1e-300)[:, None]
    from_centre = sum_groups(weight * points, group, n_groups) / total
    to_centre = sum_groups(weight * images, group, n_groups) / total
    a, b = points - from_centre[group], weight * (images - to_centre[group])
    outer = (b[:, :, None] * a[:, None, :]).reshape(-1, 9)
    u, _, vt = np.linalg.svd(sum_groups(outer, group, n_groups).reshape(-1, 3, 3))
    sign = np.ones((n_groups, 3))
    sign[:, 2] = np.linalg.det(u @ vt)
    rotation = (u * sign[:, None, :]) @ vt
    translation: F64 = to_centre - np.einsum("gij,gj->gi", rotation, from_centre)
    return rotation, translation


def sum_groups(values: F64, group: I64, n_groups: int) -> F64:
    """Return the sums (G, c) of the rows of values (n, c) that share a group number."""
    columns = [np.bincount(group, column, n_groups) for column in values.T]
    return np.stack(columns, axis=1) if columns else np.zeros((n_groups, 0))

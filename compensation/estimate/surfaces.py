"""Points on surfaces of unknown pose: the nearest point to the tip, and the start of a fit.

A reading on a surface constrains the tip along the normal only; across, the tip may be anywhere. So
its residual and all its columns lie along the normal, and it is one equation. The tip's centre is
the radius from arm.toml away, on the side from which the approach or the shaft comes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.surface_kinds import CYLINDER, PLANE, SPHERE
from armd.compensation.features.algebraic import fit_algebraic_sphere
from armd.compensation.features.fit import fit as fit_feature
from armd.compensation.features.shapes import find_across
from armd.compensation.model.kinematics import compute_pose

#: A direction with a smaller mean cosine with the normals does not determine the side.
LEAST_COSINE = 0.2


@dataclass(frozen=True)
class SurfaceFits:
    """The start of the surfaces' fit: placements, and each target's position and side."""

    rotation: F64  # (P, 3, 3), unchanged for other placements
    translation_mm: F64  # (P, 3) likewise
    target_mm: F64  # (K, 3), unchanged for other targets
    side: F64  # (K,) 1 where the tip touches from outside, -1 from inside a sphere or cylinder


def measure_heights(kind: I64, local_mm: F64) -> tuple[F64, F64]:
    """Return heights (n,) mm of points over their surface's origin, and unit vectors along them.

    *local_mm* (n, 3) are points in their surface's frame. A height is taken over the plane z = 0,
    the origin or the z axis, by *kind* (n,). The unit vectors (n, 3) are those along which heights
    grow.
    """
    offset_mm, normal = local_mm.copy(), np.tile([0.0, 0.0, 1.0], (len(kind), 1))
    offset_mm[kind == CYLINDER, 2] = 0.0
    length: F64 = np.linalg.norm(offset_mm, axis=1)
    is_round: Mask = (kind != PLANE) & (length > 0.0)
    normal[is_round] = offset_mm[is_round] / length[is_round, None]
    height: F64 = np.einsum("ni,ni->n", offset_mm, normal)
    return height, normal


def project_on_normals(normal: F64, columns: F64) -> F64:
    """Project columns (n, 3, m) of readings on a surface's *normal* (n, 3).

    A reading whose normal is 0 touches a point, and keeps all its columns.
    """
    on_surface: Mask = np.any(normal, axis=1)
    if not on_surface.any():
        return columns
    along_normal = np.einsum("ni,nim->nm", normal, columns)
    projected: F64 = np.where(
        on_surface[:, None, None], normal[:, :, None] * along_normal[:, None, :], columns
    )
    return projected


def compute_outward_directions(observations: Observations) -> tuple[F64, F64]:
    """Return unit vectors (n, 3) out of the touched surface, base frame, in two versions.

    The first is against the approach, NaN without one. The second is along the shaft of arm.toml's
    tip, up to the wrist.
    """
    arm, states = observations.arm, observations.states
    offset = np.array(arm.tip.offset_mm, dtype=float)
    shaft = -offset if offset.any() else np.array([0.0, 0.0, -1.0])
    turned = compute_pose(states.q, arm.nominal())[1]
    return -states.approach, turned @ (shaft / np.linalg.norm(shaft))


def compute_mean_cosines(observations: Observations, rows: I64, normal: F64) -> tuple[float, float]:
    """Return the mean cosines of the two outward directions with a surface's *normal* (m, 3).

    They are taken at *rows* (m,), and NaN where no row has the direction.
    """
    part = observations.rows(rows)
    means = []
    for direction in compute_outward_directions(part):
        cosine = np.einsum("ni,ni->n", direction, normal)
        finite_cosines = cosine[np.isfinite(cosine)]
        means.append(float(finite_cosines.mean()) if len(finite_cosines) else np.nan)
    return means[0], means[1]


def choose_side(approach: float, shaft: float) -> float:
    """Return 1 if a surface is touched from where its normal points to, else -1.

    The mean cosines with the normal decide: that of the approach if it is clear, otherwise the
    shaft's.
    """
    decides = approach if abs(approach) >= LEAST_COSINE else shaft  # NaN is never clear
    return -1.0 if decides < 0.0 else 1.0


def group_planes(observations: Observations) -> list[I64]:
    """Return the targets of each frame of planes: one plane, or several parallel ones."""
    rows = np.flatnonzero(observations.on_surface)
    target = observations.target[rows]
    pairs = np.stack([observations.placement[rows], target], axis=1)
    pairs = np.unique(pairs[observations.kind[target] == PLANE], axis=0)
    bodies = {tuple(pairs[pairs[:, 0] == p, 1].tolist()) for p in np.unique(pairs[:, 0])}
    return [np.array(body, dtype=np.int64) for body in sorted(bodies)]


def fit_each_surface(
    observations: Observations,
    position_mm: F64,
    rotation: F64,
    translation_mm: F64,
    target_mm: F64,
) -> SurfaceFits:
    """Fit each surface by itself to tips (n, 3) mm in the base frame, to start a common fit."""
    rotation, translation, target = rotation.copy(), translation_mm.copy(), target_mm.copy()
    radius = observations.arm.tip.radius_mm
    side = np.ones(len(target))
    every = np.flatnonzero(observations.on_surface)
    of_placement = observations.placement[every]
    for p in np.unique(of_placement):
        rows = every[of_placement == p]
        rotation[p], translation[p] = _fit_frame(observations, rows, position_mm[rows])
    height, normal = measure_heights(
        observations.kind[observations.target[every]],
        np.einsum(
            "nji,nj->ni", rotation[of_placement], position_mm[every] - translation[of_placement]
        ),
    )
    normal = np.einsum("nij,nj->ni", rotation[of_placement], normal)
    for k in np.unique(observations.target[every]):
        is_target = observations.target[every] == k
        side[k] = choose_side(
            *compute_mean_cosines(observations, every[is_target], normal[is_target])
        )
        if observations.unknown[k]:
            target[k] = 0.0, 0.0, height[is_target].mean() - side[k] * radius
    for p in np.unique(of_placement):
        rows = every[of_placement == p]
        first = observations.target[rows].min()
        if observations.kind[first] == PLANE:
            mean = height[of_placement == p][observations.target[rows] == first].mean()
            translation[p] += rotation[p][:, 2] * (mean - target[first, 2] - side[first] * radius)
    return SurfaceFits(rotation, translation, target, side)


def _fit_frame(observations: Observations, rows: I64, points: F64) -> tuple[F64, F64]:
    """Return rotation (3, 3) and origin (3,) of one surface's frame, by tips (m, 3) on it.

    A plane passes through the points of its placement's first target, seen from outside.
    """
    target = observations.target[rows]
    first = target == target.min()
    middle = points[first].mean(axis=0)
    kind = observations.kind[target[0]]
    if kind == SPHERE:
        centre, _ = fit_algebraic_sphere(points - middle)
        return np.eye(3), middle + centre
    if kind == CYLINDER:
        origin, axis = _fit_axis(points)
        return _make_upright(axis), origin
    off = np.concatenate(
        [
            points[is_target] - points[is_target].mean(axis=0)
            for is_target in (target == k for k in np.unique(target))
        ]
    )
    normal = np.linalg.svd(off, full_matrices=True)[2][2]
    normals = np.tile(normal, (int(first.sum()), 1))
    return _make_upright(
        choose_side(*compute_mean_cosines(observations, rows[first], normals)) * normal
    ), middle


def _fit_axis(points: F64) -> tuple[F64, F64]:
    """Return a point (3,) and the direction (3,) of a cylinder's axis.

    If the points do not determine an axis, it is a line among them.
    """
    try:
        feature = fit_feature("cylinder", points)
    except ArithmeticError:
        middle = points.mean(axis=0)
        return middle, np.linalg.svd(points - middle, full_matrices=True)[2][0]
    assert feature.direction is not None  # a cylinder has an axis
    return feature.point_mm, feature.direction


def _make_upright(z: F64) -> F64:
    """Return a rotation (3, 3) whose third column is *z*."""
    first_axis, second_axis = find_across(z)
    return np.stack([first_axis, second_axis, z], axis=1)

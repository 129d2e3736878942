"""Points on surfaces of unknown place: which point the tip is nearest to, and where a fit begins.

A reading on a surface says of the tip only how far it is from that, along the normal; across, it
may be anywhere. So its residual and all its columns lie along the normal, and it is one equation.
The tip's centre lies arm.toml's radius away, on the side that the approach or the shaft comes from.
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

#: A direction whose mean cosine with the normals is less does not say which side it comes from.
LEAST_COSINE = 0.2


@dataclass(frozen=True)
class SurfaceFits:
    """Where the surfaces' fit begins: their placements, and what is known of each target."""

    rotation: F64  # (P, 3, 3), of other placements as they were
    translation_mm: F64  # (P, 3) likewise
    target_mm: F64  # (K, 3) likewise
    side: F64  # (K,) 1 where the tip touches from outside, -1 from inside a sphere or cylinder


def measure_heights(kind: I64, local_mm: F64) -> tuple[F64, F64]:
    """Return heights (n,) mm over the plane z = 0, the origin or the z axis, by *kind* (n,), of
    points (n, 3) in their surface's frame, and unit vectors (n, 3) along which they grow."""
    offset_mm, normal = local_mm.copy(), np.tile([0.0, 0.0, 1.0], (len(kind), 1))
    offset_mm[kind == CYLINDER, 2] = 0.0
    length: F64 = np.linalg.norm(offset_mm, axis=1)
    is_round: Mask = (kind != PLANE) & (length > 0.0)
    normal[is_round] = offset_mm[is_round] / length[is_round, None]
    height: F64 = np.einsum("ni,ni->n", offset_mm, normal)
    return height, normal


def project_on_normals(normal: F64, columns: F64) -> F64:
    """Columns (n, 3, m) of readings, those across a surface's *normal* (n, 3) taken away; a
    reading whose normal is 0 touches a point, and keeps all of them."""
    on_surface: Mask = np.any(normal, axis=1)
    if not on_surface.any():
        return columns
    along_normal = np.einsum("ni,nim->nm", normal, columns)
    projected: F64 = np.where(
        on_surface[:, None, None], normal[:, :, None] * along_normal[:, None, :], columns
    )
    return projected


def compute_outward_directions(observations: Observations) -> tuple[F64, F64]:
    """Return unit vectors (n, 3), base frame, out of what was touched: against the approach, NaN
    without one, and along the shaft of arm.toml's tip, up to the wrist."""
    arm, states = observations.arm, observations.states
    offset = np.array(arm.tip.offset_mm, dtype=float)
    shaft = -offset if offset.any() else np.array([0.0, 0.0, -1.0])
    turned = compute_pose(states.q, arm.nominal())[1]
    return -states.approach, turned @ (shaft / np.linalg.norm(shaft))


def compute_mean_cosines(observations: Observations, rows: I64, normal: F64) -> tuple[float, float]:
    """Mean cosines of the two directions out of a surface with its *normal* (m, 3) at *rows* (m,);
    NaN where no row has the direction."""
    part = observations.rows(rows)
    means = []
    for direction in compute_outward_directions(part):
        cosine = np.einsum("ni,ni->n", direction, normal)
        finite_cosines = cosine[np.isfinite(cosine)]
        means.append(float(finite_cosines.mean()) if len(finite_cosines) else np.nan)
    return means[0], means[1]


def choose_side(approach: float, shaft: float) -> float:
    """1 where these mean cosines with a surface's normal say that it is touched from where the
    normal points to, else -1: a clear approach decides, otherwise the shaft."""
    decides = approach if abs(approach) >= LEAST_COSINE else shaft  # NaN is never clear
    return -1.0 if decides < 0.0 else 1.0


def group_planes(observations: Observations) -> list[I64]:
    """Return the targets of each frame in which planes stand at heights: one plane, or several
    parallel ones."""
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
    """Fit each surface by itself to tips (n, 3) mm in the base frame: where a fit of all begins."""
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
    """Rotation (3, 3) and origin (3,) of one surface's frame, by the tips (m, 3) that touch it.

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
    """A point (3,) and the direction (3,) of a cylinder's axis; of points that do not determine
    one, some line among them."""
    try:
        feature = fit_feature("cylinder", points)
    except ArithmeticError:
        middle = points.mean(axis=0)
        return middle, np.linalg.svd(points - middle, full_matrices=True)[2][0]
    assert feature.direction is not None  # a cylinder has an axis
    return feature.point_mm, feature.direction


def _make_upright(z: F64) -> F64:
    """A rotation (3, 3) whose third column is *z*."""
    first_axis, second_axis = find_across(z)
    return np.stack([first_axis, second_axis, z], axis=1)

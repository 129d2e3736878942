"""Fits of poses and unknown seats to the tip's positions, by least squares or robustly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from armd.arrays import F64, Mask
from armd.compensation.estimate.noise.robust import SUSPECT, find_monstrous
from armd.compensation.estimate.observations import TURN_MM, Observations
from armd.compensation.estimate.placements.placements import Placements
from armd.compensation.estimate.placements.poses import (
    Poses,
    compute_centres,
    make_pose_columns,
    make_target_columns,
)
from armd.compensation.estimate.placements.rigid_motions import fit_by_kabsch, sum_groups
from armd.compensation.estimate.surface_kinds import POINT
from armd.compensation.estimate.surfaces import fit_each_surface, project_on_normals

#: After so many reweightings, one reading in ten that is far off no longer moves a pose.
ROBUST_ROUNDS = 4
#: The median reading is never so far off under a calibration of this arm.
FOREIGN_MM = 1.0
MOST_STEPS, FOREIGN_STEPS = 50, 5


def fit_steady_poses(observations: Observations, position_mm: F64) -> Poses:
    """Return the poses of `fit_poses`, or robust ones if a reading is monstrously far off.

    The robust ones are those of `fit_robust_poses`.
    """
    poses = fit_poses(observations, position_mm)
    if find_monstrous(poses.residual(observations, position_mm), SUSPECT).any():
        steady, _ = fit_robust_poses(observations, position_mm)
        if find_monstrous(steady.residual(observations, position_mm)).any():
            return steady
    return poses


def fit_robust_poses(
    observations: Observations, position_mm: F64, roughly: bool = False
) -> tuple[Poses, F64]:
    """Fit poses that few readings far off hardly move (Cauchy's weights).

    Returns the distances (n,) mm of each reading from its target, too.

    *roughly*: where half of the readings are FOREIGN_MM off, as under another arm's calibration, a
    round takes a few steps from the end of the last round. A descent to the last digit takes fifty.
    """
    weight = np.ones(observations.n)
    begun = observations.on_surface.any()  # a new start costs much with surfaces
    start, steps = None, MOST_STEPS
    roughly = roughly and not begun and not observations.turned.any()
    if roughly:
        poses = _make_start(observations, position_mm, weight)
        start, steps = _choose_rough_start(
            poses, _measure_distances(poses, observations, position_mm)
        )
    for _ in range(ROBUST_ROUNDS):
        poses = fit_poses(observations, position_mm, weight, start, steps)
        distance = _measure_distances(poses, observations, position_mm)
        if begun:
            start = poses
        elif roughly:
            start, steps = _choose_rough_start(poses, distance)
        weight = 1.0 / (1.0 + (distance / max(float(np.median(distance)), 1e-9)) ** 2)
    return poses, distance


def _choose_rough_start(poses: Poses, distance_mm: F64) -> tuple[Poses | None, int]:
    """Return the start of a rough round, and its largest number of steps."""
    is_foreign = float(np.median(distance_mm)) > FOREIGN_MM
    return (poses, FOREIGN_STEPS) if is_foreign else (None, MOST_STEPS)


def _measure_distances(poses: Poses, observations: Observations, position_mm: F64) -> F64:
    distance: F64 = np.linalg.norm(poses.residual(observations, position_mm), axis=1)
    return distance


def fit_poses(
    observations: Observations,
    position_mm: F64,
    weight: F64 | None = None,
    start: Poses | None = None,
    most_steps: int = MOST_STEPS,
) -> Poses:
    """Fit poses and unknown seats by least squares to tip positions (n, 3) mm in the base frame.

    Certified positions count as exact here; certified distances are not used. *weight* (n,) of the
    readings; *start*: poses near by, where they are known.
    """
    weight = np.ones(observations.n) if weight is None else weight
    surfaces = observations.on_surface.any()
    if not surfaces and not _find_touched_seats(observations).any():
        return _make_start(observations, position_mm, weight)
    poses = start or _make_start(observations, position_mm, weight)
    if surfaces and start is None:
        poses = _fit_surfaces(observations, position_mm, poses)
    if start is None and observations.turned.any():
        poses = _fit_bodies(observations, position_mm, poses)
    for _ in range(most_steps):
        placed = poses.place_tips(observations, position_mm)
        centre = compute_centres(observations, placed)
        twist, step = _take_gauss_newton_step(observations, poses, position_mm, centre, weight)
        poses = poses.moved(centre, twist, step)
        if max(np.abs(twist).max(), np.abs(step).max()) < 1e-9:
            break
    return poses


def _fit_surfaces(observations: Observations, position_mm: F64, poses: Poses) -> Poses:
    """Return *poses* with those of the surfaces, each fitted by itself."""
    surface_fits = fit_each_surface(
        observations, position_mm, poses.rotation, poses.translation_mm, poses.target_mm
    )
    return Poses(
        surface_fits.rotation,
        surface_fits.translation_mm,
        surface_fits.target_mm,
        surface_fits.side,
    )


def _fit_bodies(observations: Observations, position_mm: F64, poses: Poses) -> Poses:
    """Return *poses* with the mean rotation of each measured body against the last frame."""
    rows = np.flatnonzero(observations.turned)
    frame = Rotation.from_rotvec(position_mm[rows] / TURN_MM).as_matrix()
    turns = frame.transpose(0, 2, 1) @ poses.measured(observations, rows)
    body = np.tile(np.eye(3), (len(observations.target_names), 1, 1))
    for k in np.unique(observations.target[rows]):
        body[k] = Rotation.from_matrix(turns[observations.target[rows] == k]).mean().as_matrix()
    return replace(poses, body=body)


def _find_touched_seats(observations: Observations) -> Mask:
    """Find unknown targets (K,), also surfaces, that a reading without own truth touches."""
    touched = np.zeros(len(observations.target_names), dtype=bool)
    touched[observations.target[~observations.has_truth]] = True
    return touched & observations.unknown


def _make_start(observations: Observations, position_mm: F64, weight: F64) -> Poses:
    """Fit poses by Kabsch's method and seats as the mean of their readings, by alternation.

    Without unknown seats this is the solution; with them Gauss–Newton starts here.
    """
    n_placements = len(observations.placement_names)
    target = observations.position_mm.copy()
    seats = _find_touched_seats(observations) & (observations.kind == POINT)
    row_seat = seats[observations.target] & ~observations.has_truth
    poses = Poses(np.tile(np.eye(3), (n_placements, 1, 1)), np.zeros((n_placements, 3)), target)
    if seats.any():
        _place_first_seats(observations, position_mm, target, row_seat)
    for _ in range(10 if seats.any() else 1):
        points = observations.get_known_mm(target)
        points[observations.on_surface | observations.turned] = np.nan
        rotation, translation = fit_by_kabsch(
            points, position_mm, weight, observations.placement, n_placements
        )
        local = np.einsum(
            "nji,nj->ni",
            rotation[observations.placement],
            position_mm - translation[observations.placement],
        )
        if seats.any():
            size = np.where(row_seat, observations.stretch, 0.0)
            sums = np.bincount(observations.target, weight * size**2, len(target))
            mean = sum_groups((weight * size)[:, None] * local, observations.target, len(target))
            target[seats] = mean[seats] / sums[seats, None]
        poses = Poses(rotation, translation, np.nan_to_num(target))
    return poses


def _place_first_seats(
    observations: Observations,
    position_mm: F64,
    target: F64,
    row_seat: Mask,
) -> None:
    """Give every seat a first position, in place: placement after placement, most shared first.

    A placement whose known points are too few for a pose gets one that fits them: for the first of
    a session with seats only, that is a choice of the artefact's frame.
    """
    for session in range(len(observations.session_names)):
        of_session = observations.session == session
        waiting = list(np.unique(observations.placement[of_session & row_seat]))
        while waiting:
            is_known = np.isfinite(observations.get_known_mm(target)[:, 0])
            shared = [int((is_known & (observations.placement == p)).sum()) for p in waiting]
            placement = waiting.pop(int(np.argmax(shared)))
            rows = observations.placement == placement
            points = observations.get_known_mm(target)
            index = np.zeros(int(rows.sum()), dtype=np.int64)
            alike = np.ones(len(index))
            rotation, translation = fit_by_kabsch(points[rows], position_mm[rows], alike, index, 1)
            first_rows = rows & row_seat & ~is_known
            local = (position_mm[first_rows] - translation[0]) @ rotation[0]
            sums = sum_groups(local, observations.target[first_rows], len(target))
            counts = np.bincount(observations.target[first_rows], minlength=len(target))
            target[counts > 0] = sums[counts > 0] / counts[counts > 0, None]


def _take_gauss_newton_step(
    observations: Observations, poses: Poses, position_mm: F64, centre_mm: F64, weight: F64
) -> tuple[F64, F64]:
    """Return the step of poses (P, 6) and unknown seats (K, 3), of minimum norm."""
    placed = poses.place_tips(observations, position_mm)
    normal = poses.compute_normals(observations, position_mm)
    return Placements(
        observations,
        project_on_normals(normal, make_pose_columns(observations, placed, centre_mm)),
        make_target_columns(observations, poses, normal),
        np.flatnonzero(_find_touched_seats(observations)),
        ((position_mm - placed)[:, :, None],),
        np.sqrt(weight)[:, None, None] * np.eye(3),
    ).follow(np.ones(1))

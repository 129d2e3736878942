"""Poses of the artefact, one per placement, and the positions of targets without certificate.

The functions here take the tip's positions as they are and fit only what every evaluation may fit:
poses and unknown seats.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from armd.arrays import F64, I64
from armd.compensation.estimate.observations import TURN_MM, Observations
from armd.compensation.estimate.placements.rigid_motions import sum_groups
from armd.compensation.estimate.surfaces import measure_heights

#: Lever that converts a rotation in rad to mm: it makes columns comparable.
LEVER_MM = 100.0


@dataclass(frozen=True)
class Poses:
    """Placements in the base frame, and every target's position in the artefact's frame."""

    rotation: F64  # (P, 3, 3)
    translation_mm: F64  # (P, 3)
    target_mm: F64  # (K, 3) certified or fitted; zero for a seat nobody has touched
    side: F64 | None = None  # (K,) 1 or -1: the tip's side of a surface; None: no surface
    body: F64 | None = None  # (K, 3, 3) rotations of measured bodies in the last frame

    def compute_target_points(self, observations: Observations) -> F64:
        """Return the points (n, 3) mm of the readings' targets, in the base frame."""
        points = observations.get_known_mm(self.target_mm)
        rotation = self.rotation[observations.placement]
        turned: F64 = np.einsum("nij,nj->ni", rotation, points)
        return turned + self.translation_mm[observations.placement]

    def place_tips(self, observations: Observations, position_mm: F64) -> F64:
        """Return where the tip at *position_mm* (n, 3) should stand (n, 3) mm, in the base frame.

        That is at its target, or at the nearest point of a surface.
        """
        placed = self.compute_target_points(observations)
        if self.side is not None and (rows := np.flatnonzero(observations.on_surface)).size:
            gap, normal = self._compute_gaps(observations, position_mm, rows, self.side)
            placed[rows] = position_mm[rows] - gap[:, None] * normal
        if self.body is not None and observations.turned.any():
            rows = np.flatnonzero(observations.turned)
            placed[rows] = position_mm[rows] - self._compute_turns_mm(
                position_mm, observations, rows
            )
        return placed

    def _compute_turns_mm(self, position_mm: F64, observations: Observations, rows: I64) -> F64:
        """Return rotation vectors (m, 3) from measured to the arm's orientations, × lever."""
        assert self.body is not None
        frame = Rotation.from_rotvec(position_mm[rows] / TURN_MM).as_matrix()
        of_arm = frame @ self.body[observations.target[rows]]
        off = of_arm @ self.measured(observations, rows).transpose(0, 2, 1)
        turns: F64 = TURN_MM * Rotation.from_matrix(off).as_rotvec()
        return turns

    def measured(self, observations: Observations, rows: I64) -> F64:
        """Return orientations (m, 3, 3) as measured, in the base frame."""
        turned: F64 = self.rotation[observations.placement[rows]] @ observations.measured_turn[rows]
        return turned

    def compute_normals(self, observations: Observations, position_mm: F64) -> F64:
        """Return unit vectors (n, 3) to the nearest points of surfaces, base frame; 0: points."""
        normals = np.zeros((observations.n, 3))
        if self.side is not None and (rows := np.flatnonzero(observations.on_surface)).size:
            normals[rows] = self._compute_gaps(observations, position_mm, rows, self.side)[1]
        return normals

    def _compute_gaps(
        self, observations: Observations, position_mm: F64, rows: I64, side: F64
    ) -> tuple[F64, F64]:
        """Return the distances (m,) mm of tips at *rows* (m,) from surfaces, and normals (m, 3)."""
        target, placement = observations.target[rows], observations.placement[rows]
        rotation = self.rotation[placement]
        off = position_mm[rows] - self.translation_mm[placement]
        local = np.einsum("nji,nj->ni", rotation, off)
        height, normal = measure_heights(observations.kind[target], local)
        size = observations.stretch[rows] * self.target_mm[target, 2]
        gap = height - size - side[target] * observations.arm.tip.radius_mm
        return gap, np.einsum("nij,nj->ni", rotation, normal)

    def place_at(self, observations: Observations, targets: I64) -> F64:
        """Return the tip's positions (n, k, 3) mm, had each reading touched each of *targets*."""
        points = observations.stretch[:, None, None] * self.target_mm[targets]
        rotation = self.rotation[observations.placement]
        turned: F64 = np.einsum("nij,nkj->nki", rotation, points)
        return turned + self.translation_mm[observations.placement][:, None]

    def residual(self, observations: Observations, position_mm: F64) -> F64:
        """Return tip minus target (n, 3) mm, in the base frame."""
        return position_mm - self.place_tips(observations, position_mm)

    def measure_distances(self, between: I64) -> tuple[F64, F64]:
        """Return distances (D,) mm of pairs of targets (D, 2), and their directions (D, 3).

        A direction is a unit vector from the second to the first, and zero where both are one
        point.
        """
        offset_mm = self.target_mm[between[:, 0]] - self.target_mm[between[:, 1]]
        length = np.linalg.norm(offset_mm, axis=1)
        return length, offset_mm / np.where(length > 0.0, length, 1.0)[:, None]

    def moved(self, centre_mm: F64, twist: F64, target_step_mm: F64) -> Poses:
        """Return poses moved by a twist, and targets shifted by *target_step_mm* (K, 3).

        Poses are turned by twist[:, :3] / LEVER_MM rad about their centres (P, 3) and shifted by
        twist[:, 3:] mm.
        """
        turn = Rotation.from_rotvec(twist[:, :3] / LEVER_MM).as_matrix()
        arm = self.translation_mm - centre_mm
        return Poses(
            rotation=turn @ self.rotation,
            translation_mm=centre_mm + np.einsum("pij,pj->pi", turn, arm) + twist[:, 3:],
            target_mm=self.target_mm + target_step_mm,
            side=self.side,
            body=None
            if self.body is None
            else self.body @ Rotation.from_rotvec(target_step_mm / TURN_MM).as_matrix(),
        )


def compute_centres(observations: Observations, position_mm: F64) -> F64:
    """Return the mean position of each placement's readings (P, 3); zero for one without."""
    points = ~observations.turned
    placement, p = observations.placement[points], len(observations.placement_names)
    total = sum_groups(position_mm[points], placement, p)
    return total / np.maximum(np.bincount(placement, minlength=p), 1)[:, None]


def make_pose_columns(observations: Observations, placed_mm: F64, centre_mm: F64) -> F64:
    """Return d residual / d twist (n, 3, 6) of each reading by its placement's pose.

    The lever arm is the target's, not the tip's. So turning an artefact of unknown points in its
    own frame is exactly the same as turning its placements, however large the residuals are.
    """
    columns = make_rigid_columns(placed_mm - centre_mm[observations.placement])
    columns[observations.turned] = -(TURN_MM / LEVER_MM) * np.eye(3, 6)
    return columns


def make_rigid_columns(lever_mm: F64) -> F64:
    """Return d residual / d twist (n, 3, 6) of points (n, 3) from the centre of rotation.

    A twist is a turn of 1 / LEVER_MM rad about each axis, then a shift of 1 mm along each.
    """
    lever = lever_mm / LEVER_MM
    columns = np.zeros((len(lever), 3, 6))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        columns[:, i, j] = -lever[:, k]
        columns[:, j, i] = lever[:, k]
        columns[:, i, 3 + i] = -1.0
    return columns


def make_target_columns(observations: Observations, poses: Poses, normal: F64 | None = None) -> F64:
    """Return d residual / d target position (n, 3, 3); zero where the row has its own truth.

    *normal* (n, 3) of the surfaces touched: their third coordinate moves the residual along it.
    """
    size = np.where(observations.has_truth, 0.0, observations.stretch)
    moved = poses.rotation[observations.placement]
    if normal is not None:
        of_surface = normal[:, :, None] * np.array([0.0, 0.0, 1.0])
        moved = np.where(observations.on_surface[:, None, None], of_surface, moved)
    columns: F64 = -size[:, None, None] * moved
    if (rows := np.flatnonzero(observations.turned)).size:
        columns[rows] = poses.measured(observations, rows)
    return columns

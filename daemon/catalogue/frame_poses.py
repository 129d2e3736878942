"""Frames in space, and how two of them differ."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64


@dataclass(frozen=True)
class FramePose:
    """A frame in another: rotation (3, 3) and origin (3,) mm."""

    rotation: F64
    origin: F64

    def __matmul__(self, other: FramePose) -> FramePose:
        return FramePose(self.rotation @ other.rotation, self.origin + self.rotation @ other.origin)

    @property
    def inverse(self) -> FramePose:
        return FramePose(self.rotation.T, -self.rotation.T @ self.origin)


def rotations_about(axis: F64, angles: F64) -> F64:
    """Rotation matrices (n, 3, 3) about a unit *axis* (3,)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    c, s = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    turned: F64 = c * np.eye(3) + s * cross + (1.0 - c) * np.outer(axis, axis)
    return turned


def least_rotation(one: F64, other: F64) -> F64:
    """The least rotation (3, 3) from one direction to another, less than half a turn away."""
    normal = np.cross(one, other)
    x, y, z = normal
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: F64 = np.eye(3) + cross + cross @ cross / (1.0 + float(one @ other))
    return turned


def measure_difference(one: tuple[F64, F64], other: tuple[F64, F64]) -> tuple[float, float]:
    """The largest distance in mm and the largest angle in rad, over the postures."""
    apart = np.linalg.norm(one[0] - other[0], axis=1)
    chord = np.linalg.norm(one[1] - other[1], axis=(1, 2)) / np.sqrt(8.0)
    return float(apart.max()), float(2.0 * np.arcsin(np.minimum(chord, 1.0)).max())

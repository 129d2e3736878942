"""Frames in space, and the difference of two frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64


@dataclass(frozen=True)
class FramePose:
    """The pose of a frame in another: rotation (3, 3) and origin (3,) mm."""

    rotation: F64
    origin: F64

    def __matmul__(self, frame: FramePose) -> FramePose:
        return FramePose(self.rotation @ frame.rotation, self.origin + self.rotation @ frame.origin)

    @property
    def inverse(self) -> FramePose:
        return FramePose(self.rotation.T, -self.rotation.T @ self.origin)


def make_rotations_about(axis: F64, angles: F64) -> F64:
    """Return rotation matrices (n, 3, 3) about a unit *axis* (3,), by *angles* (n,) rad."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    c, s = np.cos(angles)[:, None, None], np.sin(angles)[:, None, None]
    turned: F64 = c * np.eye(3) + s * cross + (1.0 - c) * np.outer(axis, axis)
    return turned


def find_least_rotation(start: F64, end: F64) -> F64:
    """Return the least rotation (3, 3) from one direction to another.

    They must be less than half a turn apart.
    """
    normal = np.cross(start, end)
    x, y, z = normal
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: F64 = np.eye(3) + cross + cross @ cross / (1.0 + float(start @ end))
    return turned


def measure_difference(first: tuple[F64, F64], second: tuple[F64, F64]) -> tuple[float, float]:
    """Return the largest distance in mm and the largest angle in rad over the postures."""
    distance_mm = np.linalg.norm(first[0] - second[0], axis=1)
    chord = np.linalg.norm(first[1] - second[1], axis=(1, 2)) / np.sqrt(8.0)
    return float(distance_mm.max()), float(2.0 * np.arcsin(np.minimum(chord, 1.0)).max())

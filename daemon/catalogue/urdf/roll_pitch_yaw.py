"""Rotations as URDF writes them: R = Rz(yaw)·Ry(pitch)·Rx(roll), or a quaternion x, y, z, w."""

from __future__ import annotations

import math

import numpy as np

from armd.arrays import F64

#: Nearer to pitch = ±90° than this, roll stays: only roll ∓ yaw has an effect there.
LOCKED = 1e-13


def convert_rpy_to_matrix(rpy: F64) -> F64:
    """Return the rotation matrix (3, 3) of roll, pitch, yaw (3,) rad."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def convert_quaternion_to_matrix(quaternion: F64) -> F64:
    """Return the rotation matrix (3, 3) of x, y, z, w (4,), of any length but 0."""
    x, y, z, w = quaternion / np.linalg.norm(quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def convert_matrix_to_rpy(rotation: F64, reference: F64 | None = None) -> F64:
    """Return roll, pitch, yaw (3,) rad of a rotation matrix (3, 3).

    Two triples, and whole turns, give the same rotation. The triple nearest to *reference* (3,), or
    to zero, is returned.
    """
    reference = np.zeros(3) if reference is None else reference
    across = math.hypot(rotation[2, 1], rotation[2, 2])
    pitch = math.atan2(-rotation[2, 0], across)
    roll = float(reference[0])
    if across > LOCKED:
        roll = math.atan2(rotation[2, 1], rotation[2, 2])
    triples = [(roll, pitch)]
    if across > LOCKED:
        triples.append((roll + math.pi, math.pi - pitch))
    return min(
        (_choose_nearest(rotation, *two, reference) for two in triples),
        key=lambda t: _measure_distance(t, reference),
    )


def _choose_nearest(rotation: F64, roll: float, pitch: float, reference: F64) -> F64:
    """Return the triple with this roll and pitch.

    Yaw follows from the rotation with roll undone. So their sum is exact even where roll alone has
    hardly any effect.
    """
    c, s = math.cos(roll), math.sin(roll)
    y = c * rotation[:, 1] - s * rotation[:, 2]  # (R·Rx(−roll)) e_y
    principal = np.array([roll, pitch, math.atan2(-y[0], y[1])])
    turn = 2 * math.pi
    triple: F64 = principal + turn * np.round((reference - principal) / turn)
    return triple


def _measure_distance(triple: F64, reference: F64) -> float:
    return float(np.abs(triple - reference).sum())


def convert_matrix_to_quaternion(rotation: F64) -> F64:
    """Return x, y, z, w (4,) with w ≥ 0 of a rotation matrix (3, 3)."""
    half = np.eye(4)
    half[:3, :3] = rotation + rotation.T - np.trace(rotation) * np.eye(3)
    half[:3, 3] = half[3, :3] = [
        rotation[2, 1] - rotation[1, 2],
        rotation[0, 2] - rotation[2, 0],
        rotation[1, 0] - rotation[0, 1],
    ]
    half[3, 3] = np.trace(rotation)
    quaternion: F64 = np.linalg.eigh(half)[1][:, 3]  # Bar-Itzhack, J. Guidance 23 (2000) 1085
    return quaternion if quaternion[3] >= 0 else -quaternion

"""Convert between the axes of a chain at zero angles and Denavit–Hartenberg rows.

Each row follows from the common normal of two neighbouring axes. For nearly parallel axes the
normal is ill-defined: their row is Hayati's, with d = 0 and an angle β (Hayati, CDC 1983).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import PARALLEL_DEG

#: Two points nearer than this, in mm, coincide.
SAME_MM = 1e-9


def convert_axes_to_rows(origins: F64, axes: F64, tip: F64, x: F64) -> tuple[F64, F64]:
    """Return rows (N, 5) of θ°, d mm, a mm, α°, β°, and the tip (3,) mm in the last frame.

    *origins* (N, 3) mm are a point on each axis, *axes* (N, 3) unit directions, *tip* (3,) mm; *x*
    (3,) is the first frame's, at right angles to the first axis.
    """
    rows, origin = [], origins[0]
    for z, next_origin, other_z in zip(axes[:-1], origins[1:], axes[1:], strict=True):
        if np.linalg.norm(np.cross(z, other_z)) < math.sin(math.radians(PARALLEL_DEG)):
            row, x, origin = _make_hayati_row(origin, x, z, next_origin, other_z)
        else:
            row, x, origin = _make_normal_row(origin, x, z, next_origin, other_z)
        rows.append(row)
    rows.append([0.0] * 5)
    frame = np.column_stack([x, np.cross(axes[-1], x), axes[-1]])
    return np.array(rows), frame.T @ (tip - origin)


def choose_across(z: F64) -> F64:
    """Return the unit vector (3,) along *z* × base z; along *z* × base x if z is near base z."""
    x = np.cross(z, [0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0.0, 0.0])
    unit: F64 = x / np.linalg.norm(x)
    return unit


def convert_rows_to_axes(rows: Sequence[Sequence[float]]) -> tuple[F64, F64, F64]:
    """Return the joints' axes at zero angles, and the origin of the last frame.

    *rows* (N, 5) are θ°, d mm, a mm, α°, β°. Origins (N, 3) and directions (N, 3) of the axes are
    in the base frame, as is the origin (3,) of the frame after the last row.
    """
    rotation, position = np.eye(3), np.zeros(3)
    origins, axes = [], []
    for theta, d, a, alpha, beta in rows:
        origins.append(position)
        axes.append(rotation[:, 2])
        rotation = rotation @ make_turn(2, theta)
        position = position + rotation @ np.array([a, 0.0, d])
        rotation = rotation @ make_turn(0, alpha) @ make_turn(1, beta)
    return np.array(origins), np.array(axes), position


def make_turn(axis: int, degrees: float) -> F64:
    """Return the rotation matrix (3, 3) about x, y or z (0, 1, 2)."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = c
    matrix[j, i], matrix[i, j] = s, -s
    return matrix


def _measure_angle(x: F64, normal: F64, z: F64) -> float:
    """Return the angle in degrees from *x* to *normal* about *z*."""
    return math.degrees(math.atan2(np.cross(x, normal) @ z, x @ normal))


def _make_hayati_row(
    origin: F64, x: F64, z: F64, next_origin: F64, other_z: F64
) -> tuple[list[float], F64, F64]:
    """Make the row to the point where the other axis meets the plane normal to z.

    Returns the row, the next frame's x and its origin.
    """
    point = next_origin + ((origin - next_origin) @ z) / (other_z @ z) * other_z
    length = float(np.linalg.norm(point - origin))
    normal = x if length < SAME_MM else (point - origin) / length
    y = np.cross(z, normal)
    beta = math.asin(float(np.clip(other_z @ normal, -1.0, 1.0)))
    alpha = math.atan2(-(other_z @ y), other_z @ z)
    turned = [math.cos(beta), math.sin(alpha) * math.sin(beta), -math.cos(alpha) * math.sin(beta)]
    row = [_measure_angle(x, normal, z), 0.0, length, math.degrees(alpha), math.degrees(beta)]
    return row, np.column_stack([normal, y, z]) @ turned, point


def _make_normal_row(
    origin: F64, x: F64, z: F64, next_origin: F64, other_z: F64
) -> tuple[list[float], F64, F64]:
    """Make the row along the common normal of both axes.

    Returns the row, the next frame's x and its origin.
    """
    normal = np.cross(z, other_z)
    normal /= np.linalg.norm(normal)
    s, t, _ = np.linalg.solve(np.column_stack([z, -other_z, normal]), next_origin - origin)
    foot, other_foot = origin + s * z, next_origin + t * other_z
    if (other_foot - foot) @ normal < -SAME_MM:
        normal = -normal
    alpha = math.degrees(math.atan2(np.cross(z, other_z) @ normal, z @ other_z))
    length = float((other_foot - foot) @ normal)
    return [_measure_angle(x, normal, z), float(s), length, alpha, 0.0], normal, other_foot


def format_point(point: F64) -> str:
    """Format a point as `(805, 0, 1180)`, rounded to a micrometre."""
    return "(" + ", ".join(f"{round(x, 3) + 0.0:.10g}" for x in point.tolist()) + ")"

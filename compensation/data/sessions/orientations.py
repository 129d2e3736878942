"""Columns for the orientation of a measured body in its placement's frame."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from armd.arrays import F64, Mask
from armd.compensation.data.sessions.columns import QUATERNION, ROLL_PITCH_YAW
from armd.compensation.data.tables.readings import Readings
from armd.errors import BadInput

#: A quaternion's length may differ from 1 by at most this.
MOST_OFF = 0.01


def read_orientations(readings: Readings) -> F64 | None:
    """Read rotations (n, 3, 3) of the measured body into the placement's frame, NaN if missing.

    The columns are `qx, qy, qz, qw`, or URDF's roll, pitch and yaw in degrees:
    Rz(yaw)·Ry(pitch)·Rx(roll). Returns None without such columns; raises `BadInput`.
    """
    groups = [names for names in (QUATERNION, ROLL_PITCH_YAW) if any(map(readings.has, names))]
    if not groups:
        return None
    if len(groups) > 1:
        actual = f"{QUATERNION[0]} … and {ROLL_PITCH_YAW[0]} …"
        raise BadInput(readings.path, "the header", actual, "one of them: a quaternion or angles")
    (names,) = groups
    values = np.column_stack([readings.number(name) for name in names])
    missing = np.isnan(values)
    for i, name in enumerate(names):
        partly = missing[:, i] & ~missing.all(axis=1)
        readings.refuse(partly, name, values[:, i], "a number, as in the other columns")
    complete: Mask = ~np.any(missing, axis=1)
    turns = np.full((readings.n, 3, 3), np.nan)
    if names == QUATERNION:
        length = np.linalg.norm(values, axis=1)
        readings.refuse(np.abs(length - 1.0) > MOST_OFF, names[0], length, "a length of 1")
        turns[complete] = Rotation.from_quat(values[complete]).as_matrix()
    else:
        turns[complete] = Rotation.from_euler("xyz", values[complete], degrees=True).as_matrix()
    return turns

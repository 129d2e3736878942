"""The columns of a session's readings, each checked as it is read."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Literal

import numpy as np

from armd.arrays import F64
from armd.compensation.data.sessions.format import AngleUnit
from armd.compensation.data.tables.within import LARGEST, is_within
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_motion_directions
from armd.errors import BadInput

if TYPE_CHECKING:  # Arrow is not needed for names of columns
    from armd.compensation.data.tables.readings import Readings

MemoryOrder = Literal["C", "F"]  # of an array in memory: by rows, or by columns

APPROACH = ["approach_x", "approach_y", "approach_z"]
TRUTH = ["x_mm", "y_mm", "z_mm"]
QUATERNION = ["qx", "qy", "qz", "qw"]
ROLL_PITCH_YAW = ["rx_deg", "ry_deg", "rz_deg"]

# A number beyond these limits has another unit, and is no measurement.
MOST_TURNS = 10.0
MOST_SECONDS = 10 * 365 * 86400.0
LEAST_C, MOST_C = -60.0, 150.0
MOST_RATE_RAD_S = 100.0
MOST_MM = 1e6
#: The number of rows whose Jacobians are in memory at once.
CHUNK = 1 << 16


def read_angles(
    readings: Readings,
    arm: Arm,
    unit: AngleUnit,
    *,
    missing_allowed: bool = False,
    order: MemoryOrder = "C",
) -> F64:
    """Read encoder angles (n, N) in rad; counts are converted by `direction` and counts per turn.

    *order* is that of the array in memory.
    """
    q = np.empty((readings.n, arm.n_joints), order=order)
    for k, joint in enumerate(arm.joint):
        name = f"q{k + 1}"
        values = readings.unchecked(name)
        if unit == "count":
            if joint.counts_per_turn is None:
                raise BadInput(
                    "arm.toml", f"joint[{k + 1}].counts_per_turn", "nothing", "counts per turn"
                )
            turn = float(joint.counts_per_turn)
            scale = joint.direction * math.tau / turn
        else:
            turn, scale = (math.tau, 1.0) if unit == "rad" else (360.0, math.radians(1.0))
        np.multiply(scale, values, out=q[:, k])
        # Unwrapped counts may be a turn or two off; more means another unit.
        low, high = joint.min_deg, joint.max_deg
        low = -360.0 * MOST_TURNS if low is None else low - 720.0
        high = 360.0 * MOST_TURNS if high is None else high + 720.0
        if is_within(q[:, k], math.radians(low), math.radians(high)):
            continue
        values = readings.number(name) if missing_allowed else readings.required(name)
        absurd = (q[:, k] < math.radians(low)) | (q[:, k] > math.radians(high))
        expected = f"an angle in {unit} ({turn:.10g} a turn), {low:g}° to {high:g}°"
        if unit == "rad" and not ((values < low) | (values > high)).any():
            expected += '; angle_unit = "deg" would fit'
        readings.refuse(absurd, name, values, expected)
    return q


class LikeRadians:
    """A check that refuses angles in another unit that all lie within 2π, as they would in radians.

    It judges a whole file, because an arm may rest near zero throughout a piece.
    """

    def __init__(self, arm: Arm, unit: AngleUnit) -> None:
        self._unit = unit
        turns = [360.0 if unit == "deg" else float(j.counts_per_turn or 1) for j in arm.joint]
        self._turn = np.array(turns)
        self._largest = np.zeros(arm.n_joints)  # as written
        self._rows = 0
        self._fault: BadInput | None = None

    def take(self, readings: Readings, q: F64) -> None:
        """Add the next rows, and their angles (n, N) rad."""
        if self._unit == "rad":
            return
        complete = q[np.isfinite(q).all(axis=1)]
        if not len(complete):
            return
        self._rows += len(complete)
        self._largest = np.maximum(
            self._largest, np.abs(complete).max(axis=0) * self._turn / math.tau
        )
        if self._fault is None:
            expected = f"angles in {self._unit}: all of them lie within 2π, like radians"
            first = f"{readings.number('q1')[0]:g}"
            self._fault = readings.fault(0, "q1", first, expected)

    def judge(self) -> None:
        """Raise `BadInput` at the end of the file if the angles look like radians."""
        alike = (self._turn >= 300) & (self._largest <= math.tau)
        if self._fault is not None and self._rows >= 10 and alike.all():
            raise self._fault


def read_temperatures(readings: Readings, sensors: list[str], order: MemoryOrder = "C") -> F64:
    """Read columns of °C (n, S); NaN where a value or the whole column is missing."""
    columns = np.empty((readings.n, len(sensors)), order=order)
    for s, name in enumerate(sensors):
        if not readings.has(name):
            columns[:, s] = np.nan
            continue
        columns[:, s] = values = readings.unchecked(name)
        if is_within(values, LEAST_C, MOST_C):
            continue
        values = readings.number(name)
        absurd = (values < LEAST_C) | (values > MOST_C)
        readings.refuse(absurd, name, values, f"a temperature in °C, {LEAST_C:g} to {MOST_C:g}")
    return columns


def read_times(readings: Readings) -> F64:
    """Read seconds since `started` (n,); all are NaN (time unknown) if the whole column
    is empty.
    """
    time_s = readings.number("time_s")
    if not np.isnan(time_s).all():
        time_s = readings.required("time_s")
    expected = "seconds since `started`"
    readings.refuse(np.abs(time_s) > MOST_SECONDS, "time_s", time_s, expected)
    return time_s


def list_number_columns(arm: Arm) -> list[str]:
    """List the columns of numbers that readings of this arm may have."""
    joints = range(1, arm.n_joints + 1)
    angle_and_rate = [f"{letter}{k}" for letter in "qw" for k in joints]
    truth = [*TRUTH, *QUATERNION, *ROLL_PITCH_YAW]
    return ["time_s", *angle_and_rate, *arm.sensors, "artefact_c", *APPROACH, *truth]


def read_rates(readings: Readings, n_joints: int) -> F64:
    """Read joint rates (n, N) in rad/s; NaN where a value or the whole column is missing."""
    rate = np.full((readings.n, n_joints), np.nan)
    for k in range(n_joints):
        name = f"w{k + 1}"
        if not readings.has(name):
            continue
        rate[:, k] = values = readings.number(name)
        readings.refuse(np.abs(values) > MOST_RATE_RAD_S, name, values, "a joint rate in rad/s")
    return rate


def read_approaches(
    readings: Readings, arm: Arm, q: F64, rate: F64, *, from_motion: bool = True
) -> F64:
    """Read unit vectors (n, 3): as given, else the tip's direction of motion, else NaN.

    Without *from_motion*, for a model without approaches, only given vectors are returned.
    """
    rated = any(readings.has(f"w{k}") for k in range(1, arm.n_joints + 1))
    if not (rated and from_motion) and not any(map(readings.has, APPROACH)):
        return np.full((readings.n, 3), np.nan)
    vectors = _three(readings, APPROACH)
    length = np.linalg.norm(vectors, axis=1)
    readings.refuse(np.abs(length - 1) > 0.01, APPROACH[0], length, "a vector of length 1")
    approach: F64 = vectors / length[:, None]
    if not from_motion:
        return approach
    moved = np.flatnonzero(
        np.isnan(length) & np.isfinite(rate).all(axis=1) & (rate != 0).any(axis=1)
    )
    for first in range(0, len(moved), CHUNK):
        rows = moved[first : first + CHUNK]
        approach[rows] = compute_motion_directions(q[rows], rate[rows], arm.nominal())
    return approach


def read_truths(readings: Readings) -> F64:
    """Read the tip's positions (n, 3) mm in the placement's frame; NaN where the target defines
    them.
    """
    truth = _three(readings, TRUTH)
    for i, name in enumerate(TRUTH):
        values = truth[:, i]
        if is_within(values, -MOST_MM, MOST_MM):
            continue
        readings.refuse(np.abs(values) > MOST_MM, name, values, "a position in mm")
    return truth


def _three(readings: Readings, names: list[str]) -> F64:
    """Read three columns that are all present or all absent, also row by row; NaN if absent."""
    if not any(readings.has(name) for name in names):
        return np.full((readings.n, 3), np.nan)
    columns = [readings.number(name) for name in names]
    values = np.column_stack(columns)
    if all(is_within(column, -LARGEST, LARGEST) for column in columns):  # nothing is missing
        return values
    missing = np.isnan(values)
    for i, name in enumerate(names):
        partly = missing[:, i] & ~missing.all(axis=1)
        readings.refuse(partly, name, values[:, i], "a number, as in the other two columns")
    return values

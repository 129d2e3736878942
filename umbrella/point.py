"""The point a subscriber receives: `armd.point.v1`, 136 bytes, little-endian, no padding."""

from __future__ import annotations

from enum import IntFlag

import numpy as np

POINT_ENCODING = "application/octet-stream;armd.point.v1"

#: Memory layout of one point on the wire and of a numpy array of points.
POINT = np.dtype(
    [
        ("seq", "<u8"),  # epoch << 32 | device seq
        ("stamp_ns", "<i8"),  # instant of the latch, Unix time
        ("monotonic_ns", "<i8"),  # the same instant on the controller's CLOCK_MONOTONIC
        ("position_mm", "<f8", (3,)),  # tip centre, base frame
        ("orientation", "<f8", (4,)),  # quaternion x y z w of the last frame
        ("covariance_mm2", "<f4", (6,)),  # xx xy xz yy yz zz
        ("correction_mm", "<f4", (3,)),  # corrected minus uncorrected
        ("flags", "<u4"),
        ("calibration", "<u8"),  # first eight bytes of the calibration file's SHA-256
        ("buttons", "<u4"),
        ("reserved", "<u4"),
    ]
)
assert POINT.itemsize == 136


class Flag(IntFlag):
    """Why a point deserves caution; bit numbers are part of the wire contract."""

    INVALID = 1 << 0
    """Position, orientation and covariance are NaN: a joint is invalid or its count jumped,
    or the temperature is older than the configured hold."""
    TEMPERATURE_RANGE = 1 << 1
    """A temperature lies outside the range the calibration was identified in."""
    TEMPERATURE_STALE = 1 << 2
    """A sensor that a joint uses is invalid or has not been heard for 5 s."""
    TEMPERATURE_RATE = 1 << 3
    """A temperature changes faster than the model can follow."""
    JOINT_WARNING = 1 << 4
    """A joint reports a warning; its angle still holds."""
    END_STOP = 1 << 5
    """A joint stands within 0.5 degrees of a limit."""
    SAMPLES_LOST = 1 << 6
    """The sample before this one is missing."""
    NOT_CALIBRATED = 1 << 7
    """Nominal geometry: no calibration is loaded."""
    CLOCK = 1 << 8
    """The device clock is not yet mapped to the host's."""
    AT_REST = 1 << 9
    """The tip has rested for at least 0.5 s."""

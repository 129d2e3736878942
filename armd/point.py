"""The point a subscriber receives: `armd.point.v1`, 136 bytes, little-endian, no padding."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntFlag
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

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


class Point(NamedTuple):
    """One point as Python objects; lengths in mm in the arm's base frame."""

    seq: int
    stamp_ns: int
    """Instant of the latch, Unix time."""
    monotonic_ns: int
    """The same instant on the controller's CLOCK_MONOTONIC."""
    position_mm: tuple[float, float, float]
    """Centre of the tip; NaN if flag INVALID stands."""
    orientation: tuple[float, float, float, float]
    """Quaternion x y z w of the last frame."""
    covariance_mm2: tuple[float, float, float, float, float, float]
    """xx xy xz yy yz zz."""
    correction_mm: tuple[float, float, float]
    """Corrected minus uncorrected."""
    flags: Flag
    calibration: int
    """First eight bytes of the calibration file's SHA-256, little-endian; 0: none."""
    buttons: int

    @property
    def valid(self) -> bool:
        return not self.flags & Flag.INVALID

    @classmethod
    def from_array(cls, points: npt.NDArray[np.void]) -> list[Point]:
        """One `Point` for each row of an array of `POINT`."""
        columns: dict[str, Iterable[Any]] = {name: points[name].tolist() for name in cls._fields}
        columns["flags"] = map(Flag, columns["flags"])
        for name in ("position_mm", "orientation", "covariance_mm2", "correction_mm"):
            columns[name] = map(tuple, columns[name])
        return [cls(*row) for row in zip(*columns.values(), strict=True)]


@dataclass
class Lost:
    """Points missing from a stream, by where they went."""

    upstream: int = 0
    """Never reached the daemon; flag SAMPLES_LOST tells of them."""
    here: int = 0
    """Published, but lost between the daemon and this reader."""
    restarts: int = 0
    """New streams: the arm rebooted, its counter wrapped, or the daemon started anew."""
    _last_seq: int | None = None

    @property
    def total(self) -> int:
        return self.upstream + self.here

    def begin(self) -> None:
        """The next point begins a stream anew: what lies between was not asked for."""
        self._last_seq = None

    def count(self, points: npt.NDArray[np.void]) -> None:
        """Follow the next points (n,) of the stream by their `seq`."""
        if not len(points):
            return
        seq = points["seq"].astype(np.int64)
        last = seq[0] - 1 if self._last_seq is None else self._last_seq
        missing = np.diff(seq, prepend=last) - 1
        epoch = np.diff(seq >> 32, prepend=last >> 32)
        same = (epoch == 0) & (missing >= 0)
        flagged = (points["flags"] & Flag.SAMPLES_LOST) != 0
        self.upstream += int(missing[same & flagged].sum())
        self.here += int(missing[same & ~flagged].sum())
        self.restarts += int((~same).sum())
        self._last_seq = int(seq[-1])

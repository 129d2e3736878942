"""The point that a subscriber receives: `armd.point.v1`, 136 bytes, little-endian, no padding."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntFlag
from typing import Any, Literal, NamedTuple, Self

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

FlagOrigin = Literal["sample", "arm", "calibration"]
FlagSeverity = Literal["info", "warning", "error"]


class Flag(IntFlag):
    """A warning about a point; bit numbers are part of the wire contract.

    A row defines everything about a flag: bit, origin, severity, quality, title, meaning. A sum of
    flags is a `Flag` without these attributes.
    """

    bit: int
    origin: FlagOrigin
    """What decides it. A new correction keeps a flag of the sample and decides the others again."""
    severity: FlagSeverity
    """"info" says nothing against a measurement."""
    quality: int
    """Of a position with this flag: 0 good … 100 none (Q of I++ DME)."""
    title: str
    """In a word or two, as a screen shows it."""
    meaning: str
    """One sentence for users; docs/reference/subscriber.md has the same."""

    INVALID = (
        0, "sample", "error", 100, "No position",
        "position is NaN: bad joint, impossible jump, temperature missing too long, or a non-finite"
        " result",
    )  # fmt: skip
    TEMPERATURE_RANGE = (
        1, "calibration", "warning", 50, "Outside calibrated temperatures",
        "a sensor in use, or the time of a term, is outside the calibrated range",
    )  # fmt: skip
    TEMPERATURE_STALE = (
        2, "sample", "warning", 75, "Temperature missing",
        "a sensor in use is invalid or silent for 5 s; the last value is held",
    )  # fmt: skip
    TEMPERATURE_RATE = (
        3, "sample", "warning", 50, "Temperature changes",
        "a temperature changes faster than calibration or armd.toml allow, or jumps impossibly",
    )  # fmt: skip
    JOINT_WARNING = 4, "sample", "warning", 75, "Joint warns", "a joint warns; its angle is valid"
    END_STOP = 5, "arm", "warning", 25, "End stop", "within 0.5° of a limit"
    SAMPLES_LOST = (
        6, "sample", "warning", 0, "Samples lost",
        "the sample before this one never reached the daemon",
    )  # fmt: skip
    NOT_CALIBRATED = 7, "calibration", "warning", 75, "Not calibrated", "nominal geometry"
    CLOCK = (
        8, "sample", "warning", 0, "Clock",
        "stamps are arrival times: the device's clock is not mapped, jumps, drifts over 500 ppm or"
        " answers too late",
    )  # fmt: skip
    AT_REST = 9, "sample", "info", 0, "At rest", "at rest for 0.5 s"

    def __new__(
        cls,
        bit: int,
        origin: FlagOrigin = "sample",  # defaults: `Flag(bits)` takes a sum
        severity: FlagSeverity = "warning",
        quality: int = 0,
        title: str = "",
        meaning: str = "",
    ) -> Self:
        flag = int.__new__(cls, 1 << bit)
        flag._value_ = 1 << bit
        flag.bit, flag.origin, flag.severity = bit, origin, severity
        flag.quality, flag.title, flag.meaning = quality, title, meaning
        flag.__doc__ = meaning
        return flag


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
        """Return one `Point` for each row of an array of `POINT`."""
        columns: dict[str, Iterable[Any]] = {name: points[name].tolist() for name in cls._fields}
        columns["flags"] = map(Flag, columns["flags"])
        for name in ("position_mm", "orientation", "covariance_mm2", "correction_mm"):
            columns[name] = map(tuple, columns[name])
        return [cls(*row) for row in zip(*columns.values(), strict=True)]


@dataclass
class Lost:
    """The number of points missing from a stream, by where they were lost."""

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
        """Begin a new stream with the next point: earlier points do not count as lost."""
        self._last_seq = None

    def count(self, points: npt.NDArray[np.void]) -> None:
        """Count the points that are missing before or among the next ones (n,), by their `seq`."""
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

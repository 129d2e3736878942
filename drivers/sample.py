"""What every driver delivers, whatever the wire: samples, temperatures, and what went wrong."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from armd.arrays import F64

SampleArray = npt.NDArray[np.void]


def sample_dtype(n_joints: int) -> np.dtype[np.void]:
    """One latched cycle of all joints.

    `count` is unwrapped, so a wrap at 2^bits never shows here. Its first value lies between
    −half and +half of the encoder's range; the turn in which the arm woke up is not known.
    An invalid joint's count is present but means nothing. It has a fraction only where joints
    were read one after the other and moved to the row's instant.
    """
    return np.dtype(
        [
            ("seq", "<u8"),  # epoch << 32 | device seq
            ("device_ns", "<i8"),  # latch instant on the device's clock, since its boot
            ("stamp_ns", "<i8"),  # the same instant, Unix time
            ("monotonic_ns", "<i8"),  # the same instant, the controller's CLOCK_MONOTONIC
            ("count", "<f8", (n_joints,)),  # before `direction` and `theta_deg` of arm.toml
            ("joint_invalid", "<u2"),  # bit k-1: joint k invalid (status bit, jump, alarm)
            ("joint_warning", "<u2"),  # bit k-1: joint k warns, its count still holds
            ("buttons", "<u4"),
            ("clock_mapped", "?"),  # False until device time is mapped to host time
            ("lost_before", "?"),  # seq does not follow the previous delivered sample's
        ]
    )


@dataclass(frozen=True, slots=True)
class Temperatures:
    """One reading of all channels; NaN where a channel is invalid."""

    celsius: F64  # (n_sensors,)
    device_ns: int
    monotonic_ns: int  # host arrival where the device clock is not mapped yet
    stamp_ns: int  # the same instant, Unix time
    resolution_c: float = 0.0  # of a sensor whose step is no change to be afraid of


@dataclass(frozen=True, slots=True)
class Event:
    """Something a person wants explained: a fault, a recovery, a foreign arm, a reboot."""

    kind: str  # "silence", "recovered", "reboot", "foreign_arm", …; docs/reference/wire.md
    text: str  # one sentence for a person
    monotonic_ns: int
    severity: str = "warning"  # "info", "warning", "error"
    detail: dict[str, Any] = field(default_factory=dict)


Item = SampleArray | Temperatures | Event
"""What a driver yields, in the order it happened: arrays of samples are split where a
temperature or an event falls between them, so that a replay gives the same points however
the bytes were chunked."""


Direction = Literal["rx", "tx", "link"]


class RawFrame(NamedTuple):
    """Bytes as they crossed the wire, recorded before anything decodes them.

    A decoder is fed nothing else, so the frames of one recording give the same samples again,
    bit by bit. "link" frames say that the line itself changed (b"up", b"down") or what is known
    otherwise; drivers/serial/decoder.py and drivers/can/decoder.py tell which.
    """

    monotonic_ns: int  # arrival, or just before sending
    unix_ns: int
    direction: Direction
    data: bytes  # serial: a read's bytes; CAN: see drivers/can
    channel: str = "serial"  # or "can": which decoder it is for


RAW_FRAMES_KEPT = 1 << 16  # by a driver whose raw frames nobody takes


class Driver(Protocol):
    """A source of samples. Everything happens in the caller's thread, inside `read`.

    `read` also does the driver's housekeeping when it is due (ping, time-outs, reconnection
    with back-off), so silence and recovery arrive as `Event`s like everything else; it never
    raises for a fault of the hardware.
    """

    @property
    def connected(self) -> bool:
        """Samples of the expected arm are coming in: identified, and silent for under 0.5 s."""
        ...

    @property
    def stale(self) -> bool:
        """No sample for more than 50 ms."""
        ...

    @property
    def hindrance(self) -> str:
        """What the arm says of itself that keeps a person from measuring, in words; "" if it says
        nothing of the kind."""
        ...

    @property
    def counters(self) -> dict[str, int]:
        """What was counted since `open`: samples, lost, repeated, bad_crc, reconnects, …"""
        ...

    def open(self) -> None: ...

    def read(self, timeout_s: float) -> list[Item]:
        """Wait up to *timeout_s* for bytes; return what they held, in order, maybe nothing."""
        ...

    def take_raw(self) -> list[RawFrame]:
        """The raw frames since the last call, both directions; the oldest go if nobody calls."""
        ...

    def preamble(self) -> list[RawFrame]:
        """What a recording that begins now must begin with, so that a decoder can go on from it:
        whose arm, which clock, which epoch. Empty before the arm is identified."""
        ...

    def close(self) -> None: ...

"""The items that every driver delivers, on any wire: samples, temperatures and events."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt

from armd.arrays import F64

SampleArray = npt.NDArray[np.void]


def sample_dtype(n_joints: int) -> np.dtype[np.void]:
    """Return the dtype of one latched cycle of all joints.

    `count` is unwrapped, so a wrap at 2^bits never shows here. Its first value lies between −half
    and +half of the encoder's range, because the turn at power-up is not known. An invalid joint's
    count is present but has no meaning. A count has a fraction only where joints were read one
    after the other and moved to the row's instant.
    """
    return np.dtype(
        [
            ("seq", "<u8"),  # epoch << 32 | device seq
            ("device_ns", "<i8"),  # latch instant on the device's clock, since its boot
            ("stamp_ns", "<i8"),  # the same instant, Unix time
            ("monotonic_ns", "<i8"),  # the same instant, the controller's CLOCK_MONOTONIC
            ("count", "<f8", (n_joints,)),  # before `direction` and `theta_deg` of arm.toml
            ("joint_invalid", "<u2"),  # bit k-1: joint k invalid (status bit, jump, alarm)
            ("joint_warning", "<u2"),  # bit k-1: joint k warns, its count is still valid
            ("buttons", "<u4"),
            ("clock_mapped", "?"),  # False until device time is mapped to host time
            ("lost_before", "?"),  # seq is not the previous delivered sample's + 1
        ]
    )


@dataclass(frozen=True, slots=True)
class Temperatures:
    """One reading of all channels; NaN where a channel is invalid."""

    celsius: F64  # (n_sensors,)
    device_ns: int
    monotonic_ns: int  # time of arrival where the device clock is not mapped yet
    stamp_ns: int  # the same instant, Unix time
    resolution_c: float = 0.0  # a sensor's step: a change of one step is no warning


@dataclass(frozen=True, slots=True)
class Event:
    """An incident that a user wants explained: a fault, a recovery, a foreign arm, a reboot."""

    kind: str  # "silence", "recovered", "reboot", "foreign_arm", …; docs/reference/wire.md
    text: str  # one sentence for the user
    monotonic_ns: int
    severity: str = "warning"  # "info", "warning", "error"
    detail: dict[str, Any] = field(default_factory=dict)


Item = SampleArray | Temperatures | Event
"""What a driver yields, in the order it happened: arrays of samples are split where a
temperature or an event falls between them, so that a replay gives the same points however
the bytes were chunked."""


Direction = Literal["rx", "tx", "link"]


class RawFrame(NamedTuple):
    """The bytes that crossed the wire, recorded before anything decodes them.

    A decoder is fed nothing else, so the frames of one recording give the same samples again, bit
    by bit. "link" frames record that the line itself changed (b"up", b"down"), or a fact that is
    not on the wire; drivers/serial/decoder.py and drivers/can/decoder.py define them.
    """

    monotonic_ns: int  # arrival, or just before sending
    unix_ns: int
    direction: Direction
    data: bytes  # serial: the bytes of one read; CAN: see drivers/can
    channel: str = "serial"  # or "can": the decoder that it is for


RAW_FRAMES_KEPT = 1 << 16  # by a driver if `take_raw` is not called


class Driver(Protocol):
    """A source of samples. Everything happens in the caller's thread, inside `read`.

    `read` also does the driver's housekeeping when it is due (ping, time-outs, reconnection with
    back-off). So silence and recovery arrive as `Event`s like everything else. It never raises for
    a fault of the hardware.
    """

    @property
    def connected(self) -> bool:
        """Whether samples of the expected arm are coming in: identified, and silent for under 0.5
        s.
        """
        ...

    @property
    def stale(self) -> bool:
        """Whether no sample has come for more than 50 ms."""
        ...

    @property
    def hindrance(self) -> str:
        """The reason, reported by the arm, why nobody can measure; "" if there is none."""
        ...

    @property
    def counters(self) -> dict[str, int]:
        """The numbers counted since `open`: samples, lost, repeated, bad_crc, reconnects, …"""
        ...

    def open(self) -> None: ...

    def read(self, timeout_s: float) -> list[Item]:
        """Wait up to *timeout_s* for bytes; return their items in order, maybe none."""
        ...

    def take_raw(self) -> list[RawFrame]:
        """Return the raw frames since the last call, of both directions; the oldest go if not
        taken.
        """
        ...

    def preamble(self) -> list[RawFrame]:
        """Return the frames with which a recording that starts now must begin.

        A decoder can continue from them: they hold the arm's identity, the clock and the epoch.
        Empty before the arm is identified.
        """
        ...

    def close(self) -> None: ...

"""The replay driver: a recording's raw frames through the very decoder that decoded them first."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Protocol

from pydantic import TypeAdapter

from armd.drivers.can.decoder import CanDecoder
from armd.drivers.config import (
    CanConfig,
    DriverConfig,
    MicroScribeConfig,
    ReplayConfig,
    ServoConfig,
)
from armd.drivers.identity import Expectation
from armd.drivers.microscribe.decoder import MicroScribeDecoder
from armd.drivers.poll.decoder import ServoDecoder
from armd.drivers.recording import Recording
from armd.drivers.sample import Event, Item, RawFrame
from armd.drivers.serial_decoder import SerialDecoder
from armd.errors import BadInput

BATCH = 256  # frames fed in one `read` at most


class Decoder(Protocol):
    """What all decoders have in common."""

    @property
    def accepted(self) -> bool: ...

    @property
    def counters(self) -> dict[str, int]: ...

    def feed(self, frame: RawFrame) -> list[Item]: ...


def decoder_of(recording: Recording, expectation: Expectation) -> Decoder:
    """A fresh decoder as the recorded daemon was configured; raises `BadInput`."""
    config = TypeAdapter[DriverConfig](DriverConfig).validate_python(
        recording.info["configuration"]["driver"]
    )
    if isinstance(config, ReplayConfig):
        found = f"a replay of {config.file}"
        raise BadInput(recording.path, "driver", found, "a recording of an arm")
    if isinstance(config, CanConfig):
        return CanDecoder(expectation, config.rate_hz, config.max_joint_rate_deg_s)
    if isinstance(config, ServoConfig):
        return ServoDecoder(config, expectation)
    if isinstance(config, MicroScribeConfig):
        return MicroScribeDecoder(expectation, config.max_joint_rate_deg_s)
    return SerialDecoder(expectation, config.max_joint_rate_deg_s)


class ReplayDriver:
    """See `armd.drivers.sample.Driver`. Stamps are those of the recording.

    At its end it delivers one event `replay_ended`, and then nothing.
    """

    def __init__(self, config: ReplayConfig, expectation: Expectation) -> None:
        self._recording = recording = Recording(config.file)
        self._speed = config.speed
        self._decoder = decoder_of(recording, expectation)
        self._frames: Iterator[RawFrame] = recording.frames()
        self._next: RawFrame | None = None
        self._before: list[Item] = []  # what the preamble told
        self._ended = False
        self._began_ns = 0  # on this machine's clock, and on the recording's
        self._first_ns = 0

    @property
    def connected(self) -> bool:
        return self._decoder.accepted and not self._ended

    @property
    def stale(self) -> bool:
        return not self.connected

    @property
    def hindrance(self) -> str:
        return ""

    @property
    def counters(self) -> dict[str, int]:
        return {**self._decoder.counters, "reconnects": 0}

    def open(self) -> None:
        self._before = [
            item for frame in self._recording.preamble() for item in self._decoder.feed(frame)
        ]
        self._next = next(self._frames, None)
        self._began_ns = time.monotonic_ns()
        self._first_ns = self._next.monotonic_ns if self._next else 0

    def close(self) -> None:
        self._ended = True

    def take_raw(self) -> list[RawFrame]:
        return []  # they are recorded already

    def preamble(self) -> list[RawFrame]:
        return []

    def read(self, timeout_s: float) -> list[Item]:
        deadline_ns = time.monotonic_ns() + round(timeout_s * 1e9)
        items, self._before = self._before, []
        for _ in range(BATCH):
            if self._next is None:
                return items + self._end(deadline_ns if not items else 0)
            due_ns = self._due_ns(self._next)
            if due_ns > time.monotonic_ns() and items:
                return items
            _sleep_until(min(due_ns, deadline_ns))
            if due_ns > deadline_ns:
                return items
            items += self._decoder.feed(self._next)
            self._next = next(self._frames, None)
        return items

    def _due_ns(self, frame: RawFrame) -> int:
        if self._speed == 0:
            return 0
        return self._began_ns + round((frame.monotonic_ns - self._first_ns) / self._speed)

    def _end(self, deadline_ns: int) -> list[Item]:
        if self._ended:
            _sleep_until(deadline_ns)
            return []
        self._ended = True
        return [Event("replay_ended", "the recording is over", time.monotonic_ns(), "info")]


def _sleep_until(instant_ns: int) -> None:
    time.sleep(max(0, instant_ns - time.monotonic_ns()) / 1e9)

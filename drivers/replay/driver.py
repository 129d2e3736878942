"""The replay driver: feeds a recording's raw frames to the same decoder as when it was recorded."""

from __future__ import annotations

import time
from collections.abc import Iterator

from armd.drivers.can.decoder import CanDecoder
from armd.drivers.config import (
    CanConfig,
    MicroScribeConfig,
    ReplayConfig,
    SerialConfig,
    ServoConfig,
)
from armd.drivers.identity import Expectation
from armd.drivers.microscribe.decoder import MicroScribeDecoder
from armd.drivers.poll.decoder import ServoDecoder
from armd.drivers.replay.recording import Recording
from armd.drivers.sample import Event, Item, RawFrame
from armd.drivers.serial.decoder import SerialDecoder
from armd.drivers.shell import Decoder
from armd.drivers.table import DRIVERS
from armd.errors import BadInput
from armd.files.schema import validate

_CAN_KEYS = {"rate_hz", "max_joint_rate_deg_s"}
BATCH = 256  # the most frames fed in one `read`


def make_decoder(recording: Recording, expectation: Expectation) -> Decoder:
    """Make a fresh decoder with the recorded daemon's configuration; raises `BadInput`."""
    driver = recording.driver
    location = f"{recording.path}: configuration of the recorded daemon"
    match driver["kind"]:
        case "serial":
            serial = validate(location, driver, SerialConfig)
            return SerialDecoder(expectation, serial.max_joint_rate_deg_s)
        case "can":  # python-can's own keys describe a bus that is not here
            ours = {key: driver[key] for key in _CAN_KEYS & driver.keys()}
            can = validate(location, ours | {"kind": "can", "interface": "virtual"}, CanConfig)
            return CanDecoder(expectation, can.rate_hz, can.max_joint_rate_deg_s)
        case "feetech" | "dynamixel" | "dynamixel1":
            return ServoDecoder(validate(location, driver, ServoConfig), expectation)
        case "microscribe":
            scribe = validate(location, driver, MicroScribeConfig)
            return MicroScribeDecoder(expectation, scribe.max_joint_rate_deg_s, scribe.stream)
        case str(kind) if kind not in DRIVERS:
            from armd.drivers.plugin import load_plugin_driver

            model = load_plugin_driver(kind, DRIVERS)
            plugin = None if model is None else validate(location, driver, model)
            decoder = None if plugin is None else plugin.make_decoder(expectation)
            if decoder is not None:
                return decoder
    actual = repr(driver["kind"])[:80]
    raise BadInput(location, "driver.kind", actual, "a kind whose recordings can be replayed")


class ReplayDriver:
    """Plays a recording; see `armd.drivers.sample.Driver`. Stamps are those of the recording.

    At its end it delivers one event `replay_ended`, and then nothing.
    """

    def __init__(self, config: ReplayConfig, expectation: Expectation) -> None:
        self._recording = recording = Recording(config.file)
        self._speed = config.speed
        self._decoder = make_decoder(recording, expectation)
        self._frames: Iterator[RawFrame] = recording.frames()
        self._next: RawFrame | None = None
        self._before: list[Item] = []  # items of the preamble
        self._ended = False
        self._began_ns = 0  # on this machine's clock; `_first_ns` on the recording's
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
            item for frame in self._recording.preamble() for item in self._decode(frame)
        ]
        if self._recording.missing is not None:
            now_ns = time.monotonic_ns()
            self._before.append(Event("recording_cut", self._recording.missing, now_ns, "warning"))
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
            items += self._decode(self._next)
            self._next = next(self._frames, None)
        return items

    def _decode(self, frame: RawFrame) -> list[Item]:
        """Decode a frame; raises `BadInput` where the decoder fails, as on a forged file."""
        try:
            return self._decoder.feed(frame)
        except Exception as error:
            location = f"raw frame of {frame.unix_ns} ns"
            expected = "one that its decoder understands"
            raise BadInput(self._recording.path, location, repr(error)[:200], expected) from error

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

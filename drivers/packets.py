"""The base of drivers whose arm sends one packet a sample.

A package adds how a packet is received and decoded (docs/developer/plugins.md). The arm has no
clock that is known here. So a sample's time is its packet's arrival, and every point carries the
flag CLOCK. `serial/clock.py` is for wires that send the time of their samples.
"""

from __future__ import annotations

import struct
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from armd.drivers.identity import Expectation
from armd.drivers.joint_watch import JointWatch
from armd.drivers.sample import Item, RawFrame, Temperatures, sample_dtype
from armd.drivers.shell import Shell
from armd.drivers.unwrap import MAX_JOINT_RATE_DEG_S, Unwrapper, load_compiled

WRAP = 1 << 32
#: Packets sent this far apart may arrive together, so a count may have moved for this much longer.
LATE_US = 50_000
#: A packet fewer numbers behind the last one came late or twice; otherwise the arm has restarted.
LATE_NUMBERS = 64
RENEW_NS = 1_000_000_000
BATCH = 256  # the most packets taken in one `read`


class SamplePacket(NamedTuple):
    """The content of one packet."""

    number: int
    """Of the sample, as the arm counts them: 0 to 2^32 - 1, one more each time."""
    counts: Sequence[int]
    """(N,) of the encoders; they wrap at arm.toml's `counts_per_turn`."""
    buttons: int = 0
    joint_invalid: int = 0
    """Bit k-1: the arm calls joint k invalid."""
    celsius: Sequence[float] = ()
    """(n_sensors,) °C, NaN where a channel is invalid; empty: none in this packet."""


class PacketDecoder(ABC):
    """Decodes packets to samples, each once and in order; see `armd.drivers.shell.Decoder`."""

    #: Whether the connected arm is the expected one, where packets carry an identity.
    accepted = True

    def __init__(self, expectation: Expectation) -> None:
        self.expectation = expectation
        self.last_sample_ns: int | None = None
        self.counters = {"samples": 0, "lost": 0, "malformed": 0, "repeated": 0}
        turns = [count or WRAP for count in expectation.counts_per_turn]
        self._unwrapper = Unwrapper(turns, turns, MAX_JOINT_RATE_DEG_S)
        self._dtype = sample_dtype(expectation.n_joints)
        self._seq: int | None = None  # of the last sample: epoch << 32 | number
        self._watches = (
            JointWatch("joint_invalid", "the arm calls it invalid", "the arm calls it valid"),
            JointWatch("count_jump", "its count jumped", "it jumps no more"),
        )

    @abstractmethod
    def read_packet(self, data: bytes) -> SamplePacket:
        """Decode the bytes of a packet; raises `ValueError` or `struct.error` for invalid bytes."""

    def feed(self, frame: RawFrame) -> list[Item]:
        """Return the items of one packet: temperatures, events of joints, the sample."""
        if frame.direction != "rx":
            return []
        try:
            packet = self._sound(self.read_packet(frame.data))
        except (ValueError, struct.error):
            self.counters["malformed"] += 1
            return []
        items: list[Item] = []
        if len(packet.celsius):
            celsius = np.array(packet.celsius, float)
            at_ns = frame.monotonic_ns
            items.append(Temperatures(celsius, at_ns, at_ns, frame.unix_ns))
        last = self._seq
        if last is not None and (last - packet.number) % WRAP < LATE_NUMBERS:
            self.counters["repeated"] += 1
            return items
        return [*items, *self._sample(packet, frame, last)]

    def preamble(self) -> list[RawFrame]:
        return []

    def warm_up(self) -> None:
        load_compiled()

    def _sound(self, packet: SamplePacket) -> SamplePacket:
        n_joints, n_sensors = self.expectation.n_joints, self.expectation.n_sensors
        if not (0 <= packet.number < WRAP and len(packet.counts) == n_joints):
            raise ValueError(packet)
        if len(packet.celsius) not in (0, n_sensors):
            raise ValueError(packet)
        return packet

    def _sample(self, packet: SamplePacket, frame: RawFrame, last: int | None) -> list[Item]:
        epoch, expected = (0, packet.number) if last is None else (last >> 32, last + 1)
        if last is not None and packet.number < last % WRAP:
            epoch += 1
            if (packet.number - last) % WRAP > WRAP // 2:  # no wrap: the arm has restarted
                self._unwrapper.restart()
        self._seq = epoch << 32 | packet.number
        if self._seq >> 32 == expected >> 32:
            self.counters["lost"] += self._seq - expected
        self.counters["samples"] += 1
        self.last_sample_ns = frame.monotonic_ns
        invalid = np.array([packet.joint_invalid], np.uint16)
        us = frame.monotonic_ns // 1000 + LATE_US * self.counters["samples"]
        counts = np.array([packet.counts], np.int64)
        count, jumped = self._unwrapper(counts, np.array([us]), invalid)
        sample = np.zeros(1, self._dtype)
        sample["seq"], sample["lost_before"] = self._seq, self._seq != expected
        sample["device_ns"] = sample["monotonic_ns"] = frame.monotonic_ns
        sample["stamp_ns"] = frame.unix_ns
        sample["count"], sample["buttons"] = count, packet.buttons
        sample["joint_invalid"] = invalid | jumped
        pairs = zip(self._watches, (invalid, jumped), strict=True)
        return [*(event for watch, bad in pairs for event in watch.events(sample, bad)), sample]


class PacketDriver(Shell[PacketDecoder]):
    """Takes packets as they arrive; see `armd.drivers.sample.Driver`.

    The package implements `open`, `receive` and `close`.
    """

    def __init__(self, decoder: PacketDecoder, name: str) -> None:
        """Take the decoder, and the *name* of the line for messages."""
        super().__init__(decoder, name, RENEW_NS, "packets")
        decoder.warm_up()

    @abstractmethod
    def open(self) -> None:
        """Open the line; an exception is reported, and `open` is called again."""

    @abstractmethod
    def receive(self, timeout_s: float) -> bytes:
        """Return the next packet; raises `TimeoutError` or `BlockingIOError` if none comes."""

    def read(self, timeout_s: float) -> list[Item]:
        items: list[Item] = []
        with suppress(TimeoutError, BlockingIOError):
            for _ in range(BATCH):
                items += self._feed("rx", self.receive(timeout_s))
                timeout_s = 0.0
        now_ns = time.monotonic_ns()
        items = self._line.heard(self._decoder.last_sample_ns, items)
        return [*items, *self._line.silent(now_ns)] if now_ns >= self._line.act_ns else items

"""The serial driver: opens and reads a port that may vanish; the decoder never sees one.

It has no thread: everything happens in `read`, in the caller's thread.
"""

from __future__ import annotations

import time

import serial

from armd.drivers.config import SerialConfig
from armd.drivers.identity import Expectation
from armd.drivers.sample import Event, Item
from armd.drivers.serial import wire
from armd.drivers.serial.decoder import SerialDecoder
from armd.drivers.shell import SerialShell

IDENTIFY_INTERVAL_NS = 100_000_000
IDENTIFY_PATIENCE = 10  # requests without an answer before an event is sent
GOLDEN_RATIO = 0.6180339887  # its multiples, modulo 1, are evenly spread and never repeat


class SerialDriver(SerialShell[SerialDecoder]):
    """The driver of armd's own serial wire; see `armd.drivers.sample.Driver`."""

    def __init__(self, config: SerialConfig, expectation: Expectation) -> None:
        super().__init__(SerialDecoder(expectation, config.max_joint_rate_deg_s), config.port)
        self._baud = config.baud
        self._nonce = 0
        self._stretch = 0.75  # factor of the interval to the next PING
        self._identify_sent = 0  # IDENTIFY sent on this connection
        self._identify_due_ns = self._pinged_ns = 0

    def read(self, timeout_s: float) -> list[Item]:
        deadline_ns = time.monotonic_ns() + round(timeout_s * 1e9)
        items: list[Item] = []
        while True:
            items += self._housekeeping(time.monotonic_ns())
            wait_ns = max(0, min(deadline_ns, self._next_due_ns()) - time.monotonic_ns())
            if self._port is None:
                time.sleep(wait_ns / 1e9)
            elif self._poll.poll(wait_ns / 1e6):
                items += self._receive(self._port)
            elif time.monotonic_ns() >= self._line.act_ns:  # never while bytes are waiting
                items += self._renew()
            if items or time.monotonic_ns() >= deadline_ns:
                break
        return items

    # --- what is due, bytes or not ---------------------------------------------------------

    def _next_due_ns(self) -> int:
        if self._port is None:
            return self._line.open_due_ns
        due_ns = min(self._ping_due_ns(), self._line.act_ns)
        return min(due_ns, self._identify_due_ns) if self._decoder.wants_identity else due_ns

    def _ping_due_ns(self) -> int:
        return self._pinged_ns + int(self._decoder.ping_interval_ns * self._stretch)

    def _housekeeping(self, now_ns: int) -> list[Item]:
        if self._port is None:
            return self._try_open(now_ns) if now_ns >= self._line.open_due_ns else []
        if now_ns >= self._ping_due_ns():
            self._pinged_ns = now_ns
            self._nonce = (self._nonce + 1) & 0xFFFFFFFF
            # The interval varies, so that some PINGs arrive while the arm is idle.
            self._stretch = 0.75 + 0.5 * (self._nonce * GOLDEN_RATIO % 1)
            self._send(self._port, wire.encode_ping(self._nonce))
        if not self._decoder.wants_identity:
            self._identify_sent = 0
            return []
        if now_ns < self._identify_due_ns:
            return []
        self._identify_due_ns = now_ns + IDENTIFY_INTERVAL_NS
        self._send(self._port, wire.encode_identify())
        self._identify_sent += 1
        if self._identify_sent != IDENTIFY_PATIENCE or self._decoder.last_sample_ns is None:
            return []
        text = "samples arrive, but the arm does not answer IDENTIFY: whose are they?"
        return [Event("unidentified", text, now_ns, "error")]

    def _send(self, port: serial.Serial, data: bytes) -> None:
        frame = self._write(port, data)
        if frame is not None:
            self._take(frame)

    # --- the port --------------------------------------------------------------------------

    def _try_open(self, now_ns: int) -> list[Item]:
        missing = self._open_port(self._baud, now_ns)
        if self._port is None:
            return missing
        self._line.opened(now_ns)
        self._pinged_ns, self._identify_due_ns = 0, now_ns
        self._identify_sent = 0
        return self._feed("link", b"up")

    def _received(self, port: serial.Serial, data: bytes) -> list[Item]:
        items = self._feed("rx", data)
        return self._line.heard(self._decoder.last_sample_ns, items)

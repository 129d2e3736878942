"""The serial driver: a port that may vanish, around the decoder that never sees one.

pyserial opens and configures; then bytes are read from its descriptor, whatever is there at
once. No thread: everything happens in `read`, in the caller's.
"""

from __future__ import annotations

import os
import select
import termios
import time
from collections import deque
from contextlib import suppress

import serial

from armd.drivers.config import SerialConfig
from armd.drivers.host_time import HostTime
from armd.drivers.identity import Expectation
from armd.drivers.line_health import SILENCE_NS, STALE_NS, LineHealth
from armd.drivers.sample import RAW_FRAMES_KEPT, Direction, Event, Item, RawFrame
from armd.drivers.serial import wire
from armd.drivers.serial.decoder import SerialDecoder

READ_BYTES = 1 << 16
IDENTIFY_INTERVAL_NS = 100_000_000
IDENTIFY_PATIENCE = 10  # requests without an answer before a person is told
GOLDEN_RATIO = 0.6180339887  # its multiples fall evenly, and never in step
RENEW_NS = 1_000_000_000  # a port that stays silent is opened afresh this often


class SerialDriver:
    """See `armd.drivers.sample.Driver`."""

    def __init__(self, config: SerialConfig, expectation: Expectation) -> None:
        self._config = config
        self._decoder = SerialDecoder(expectation, config.max_joint_rate_deg_s)
        self._time = HostTime()
        self._line = LineHealth(config.port, RENEW_NS)
        self._serial: serial.Serial | None = None
        self._poll = select.poll()
        self._raw: deque[RawFrame] = deque(maxlen=RAW_FRAMES_KEPT)
        self._nonce = 0
        self._asked = 0  # IDENTIFY sent on this connection
        self._identify_due_ns = self._ping_due_ns = 0

    @property
    def connected(self) -> bool:
        return self._decoder.accepted and self._line.quiet_ns < SILENCE_NS

    @property
    def stale(self) -> bool:
        return not self._decoder.accepted or self._line.quiet_ns > STALE_NS

    @property
    def hindrance(self) -> str:
        return ""

    @property
    def counters(self) -> dict[str, int]:
        return {**self._decoder.counters, "reconnects": self._line.reconnects}

    def open(self) -> None:
        """Get ready; the port itself is opened by the first `read`, which goes on trying."""
        self._decoder.warm_up()

    def close(self) -> None:
        if self._serial is not None:
            with suppress(OSError):
                self._poll.unregister(self._serial.fileno())
            with suppress(OSError):
                self._serial.close()
            self._serial = None

    def take_raw(self) -> list[RawFrame]:
        raw = list(self._raw)
        self._raw.clear()
        return raw

    def preamble(self) -> list[RawFrame]:
        return self._decoder.preamble()

    def read(self, timeout_s: float) -> list[Item]:
        deadline_ns = time.monotonic_ns() + round(timeout_s * 1e9)
        items: list[Item] = []
        while not items:
            items += self._housekeeping(time.monotonic_ns())
            wait_ns = max(0, min(deadline_ns, self._next_due_ns()) - time.monotonic_ns())
            if self._serial is None:
                time.sleep(wait_ns / 1e9)
            elif self._poll.poll(wait_ns / 1e6):
                items += self._receive(self._serial)
            elif time.monotonic_ns() >= self._line.act_ns:  # never while bytes are waiting
                items += self._renew()
            if time.monotonic_ns() >= deadline_ns:
                break
        return items

    # --- what is due, bytes or not ---------------------------------------------------------

    def _next_due_ns(self) -> int:
        if self._serial is None:
            return self._line.open_due_ns
        due = min(self._ping_due_ns, self._line.act_ns)
        return min(due, self._identify_due_ns) if self._decoder.wants_identity else due

    def _housekeeping(self, now_ns: int) -> list[Item]:
        if self._serial is None:
            return self._try_open(now_ns) if now_ns >= self._line.open_due_ns else []
        if now_ns >= self._ping_due_ns:
            # Out of step with the arm's own beat, so that some PING finds it idle.
            stretch = 0.75 + 0.5 * (self._nonce * GOLDEN_RATIO % 1)
            self._ping_due_ns = now_ns + round(self._decoder.clock.ping_interval_ns * stretch)
            self._nonce = (self._nonce + 1) & 0xFFFFFFFF
            self._send(self._serial, wire.encode_ping(self._nonce))
        if not self._decoder.wants_identity or now_ns < self._identify_due_ns:
            return []
        self._identify_due_ns = now_ns + IDENTIFY_INTERVAL_NS
        self._send(self._serial, wire.encode_identify())
        self._asked = self._asked + 1 if self._decoder.hello is None else 0
        if self._asked != IDENTIFY_PATIENCE or self._decoder.last_sample_ns is None:
            return []
        text = "samples arrive, but the arm does not answer IDENTIFY: whose are they?"
        return [Event("unidentified", text, now_ns, "error")]

    # --- the port --------------------------------------------------------------------------

    def _try_open(self, now_ns: int) -> list[Item]:
        port = self._config.port
        try:
            self._serial = serial.Serial(port, self._config.baud, timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:  # SerialException is an OSError
            return self._line.lost("port_missing", str(error), now_ns)
        with suppress(OSError, ValueError):  # a pty has no such mode
            self._serial.set_low_latency_mode(True)
        self._poll.register(self._serial.fileno(), select.POLLIN)
        self._line.opened(now_ns)
        self._ping_due_ns = self._identify_due_ns = now_ns
        self._asked = 0
        self._feed("link", b"up")
        return []

    def _renew(self) -> list[Item]:
        """Silence: perhaps the adapter hangs, perhaps the name now means another device."""
        self._hang_up()
        now_ns = time.monotonic_ns()
        return [*self._line.silent(now_ns), *self._try_open(now_ns)]

    def _unplugged(self, reason: str) -> list[Item]:
        self._hang_up()
        text = f"the line to {self._config.port} broke: {reason}"
        return self._line.lost("unplugged", text, time.monotonic_ns())

    def _hang_up(self) -> None:
        self.close()
        self._feed("link", b"down")

    # --- bytes -----------------------------------------------------------------------------

    def _receive(self, port: serial.Serial) -> list[Item]:
        try:
            data = os.read(port.fileno(), READ_BYTES)
        except BlockingIOError:
            return []
        except OSError as error:
            return self._unplugged(str(error))
        if not data:
            return self._unplugged("end of file")
        items = self._feed("rx", data)
        return self._line.heard(self._decoder.last_sample_ns, items)

    def _send(self, port: serial.Serial, packet: bytes) -> None:
        self._feed("tx", packet)
        with suppress(OSError):  # a full or broken line shows itself when reading
            os.write(port.fileno(), packet)

    def _feed(self, direction: Direction, data: bytes) -> list[Item]:
        monotonic_ns, unix_ns = self._time.now()
        frame = RawFrame(monotonic_ns, unix_ns, direction, data)
        self._raw.append(frame)
        return self._decoder.feed(frame)

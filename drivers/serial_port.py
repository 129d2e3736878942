"""The serial driver: a port that may vanish, around the decoder that never sees one.

pyserial opens and configures; then bytes are read from its descriptor, whatever is there at
once. No thread: everything happens in `read`, in the caller's.
"""

from __future__ import annotations

import os
import select
import termios
import time
from contextlib import suppress

import numpy as np
import serial

from armd.drivers import serial_wire as wire
from armd.drivers.config import SerialConfig
from armd.drivers.host_time import HostTime
from armd.drivers.identity import Expectation
from armd.drivers.sample import Direction, Event, Item, RawFrame
from armd.drivers.serial_decoder import SerialDecoder
from armd.drivers.unwrap import warm_up

READ_BYTES = 1 << 16
STALE_NS = 50_000_000
SILENCE_NS = 500_000_000
IDENTIFY_INTERVAL_NS = 100_000_000
IDENTIFY_PATIENCE = 10  # requests without an answer before a person is told
BACK_OFF_FIRST_S, BACK_OFF_MOST_S = 0.02, 0.2
REOPEN_SILENT_NS = 1_000_000_000  # a port that stays silent is opened afresh this often


class SerialDriver:
    """See `armd.drivers.sample.Driver`."""

    def __init__(self, config: SerialConfig, expectation: Expectation) -> None:
        self._config = config
        self._decoder = SerialDecoder(expectation, config.max_joint_rate_deg_s)
        self._time = HostTime()
        self._serial: serial.Serial | None = None
        self._poll = select.poll()
        self._raw: list[RawFrame] = []
        self._opened = 0
        self._nonce = 0
        self._asked = 0  # IDENTIFY sent on this connection
        self._back_off_s = BACK_OFF_FIRST_S
        self._trouble: tuple[str, int] | None = None  # what is wrong, since when
        now = time.monotonic_ns()
        self._open_due_ns = self._identify_due_ns = self._ping_due_ns = now
        self._quiet_since_ns = now  # last sample, or the opening of the port

    @property
    def connected(self) -> bool:
        return self._decoder.accepted and self._quiet_ns() < SILENCE_NS

    @property
    def stale(self) -> bool:
        return not self._decoder.accepted or self._quiet_ns() > STALE_NS

    @property
    def counters(self) -> dict[str, int]:
        return {**self._decoder.counters, "reconnects": max(0, self._opened - 1)}

    def open(self) -> None:
        """Get ready; the port itself is opened by the first `read`, which goes on trying."""
        warm_up()

    def close(self) -> None:
        if self._serial is not None:
            with suppress(OSError):
                self._poll.unregister(self._serial.fileno())
            with suppress(OSError, serial.SerialException):
                self._serial.close()
            self._serial = None

    def take_raw(self) -> list[RawFrame]:
        raw, self._raw = self._raw, []
        return raw

    def read(self, timeout_s: float) -> list[Item]:
        deadline_ns = time.monotonic_ns() + round(timeout_s * 1e9)
        items: list[Item] = []
        while not items:
            items += self._housekeeping(time.monotonic_ns())
            wait_ns = min(deadline_ns, self._next_due_ns()) - time.monotonic_ns()
            if self._serial is None:
                time.sleep(max(0, wait_ns) / 1e9)
            elif self._poll.poll(max(0, wait_ns) / 1e6):
                items += self._receive()
            elif time.monotonic_ns() >= self._silence_due_ns():  # never while bytes are waiting
                items += self._silent()
            if time.monotonic_ns() >= deadline_ns:
                break
        return items

    # --- what is due, bytes or not ---------------------------------------------------------

    def _next_due_ns(self) -> int:
        if self._serial is None:
            return self._open_due_ns
        due = min(self._ping_due_ns, self._silence_due_ns())
        return min(due, self._identify_due_ns) if self._decoder.wants_identity else due

    def _silence_due_ns(self) -> int:
        """When the silence is to be reported, and then when the port is to be opened afresh."""
        return self._quiet_since_ns + (REOPEN_SILENT_NS if self._trouble else SILENCE_NS)

    def _housekeeping(self, now_ns: int) -> list[Item]:
        if self._serial is None:
            return self._try_open(now_ns) if now_ns >= self._open_due_ns else []
        items: list[Item] = []
        if self._decoder.wants_identity and now_ns >= self._identify_due_ns:
            self._identify_due_ns = now_ns + IDENTIFY_INTERVAL_NS
            self._send(wire.encode_identify())
            self._asked += 1
            if self._asked == IDENTIFY_PATIENCE and self._decoder.last_sample_ns is not None:
                text = "samples arrive, but the arm does not answer IDENTIFY: whose are they?"
                items.append(Event("unidentified", text, now_ns, "error"))
        if now_ns >= self._ping_due_ns:
            self._ping_due_ns = now_ns + self._decoder.clock.ping_interval_ns
            self._nonce = (self._nonce + 1) & 0xFFFFFFFF
            self._send(wire.encode_ping(self._nonce))
        return items

    def _silent(self) -> list[Item]:
        now_ns = time.monotonic_ns()
        items: list[Item] = []
        if self._trouble is None:
            text = f"no sample for {SILENCE_NS / 1e9:.1f} s on {self._config.port}"
            items.append(self._fault("silence", text, self._quiet_since_ns, now_ns))
        self.close()
        self._feed("link", b"down")
        return items + self._try_open(now_ns)

    def _try_open(self, now_ns: int) -> list[Item]:
        try:
            self._serial = serial.Serial(
                self._config.port, self._config.baud, timeout=0, exclusive=True
            )
        except (OSError, ValueError, termios.error) as error:  # SerialException is an OSError
            self._open_due_ns = now_ns + round(self._back_off_s * 1e9)
            self._back_off_s = min(2 * self._back_off_s, BACK_OFF_MOST_S)
            if self._trouble is not None:
                return []
            return [self._fault("port_missing", str(error), now_ns, now_ns)]
        with suppress(OSError, ValueError):  # a pty has no such mode
            self._serial.set_low_latency_mode(True)
        self._poll.register(self._serial.fileno(), select.POLLIN)
        self._back_off_s = BACK_OFF_FIRST_S
        self._quiet_since_ns = self._ping_due_ns = self._identify_due_ns = now_ns
        self._asked = 0
        self._opened += 1
        self._feed("link", b"up")
        return []

    # --- bytes -----------------------------------------------------------------------------

    def _receive(self) -> list[Item]:
        assert self._serial is not None
        try:
            data = os.read(self._serial.fileno(), READ_BYTES)
        except BlockingIOError:
            return []
        except OSError as error:
            return self._unplugged(str(error))
        if not data:
            return self._unplugged("end of file")
        items = self._feed("rx", data)
        if self._decoder.last_sample_ns is not None:
            self._quiet_since_ns = max(self._quiet_since_ns, self._decoder.last_sample_ns)
        if self._trouble is not None:
            first = next((i for i, item in enumerate(items) if isinstance(item, np.ndarray)), None)
            if first is not None:
                items.insert(first, self._recovered())
        return items

    def _unplugged(self, reason: str) -> list[Item]:
        now_ns = time.monotonic_ns()
        items: list[Item] = []
        if self._trouble is None:
            text = f"the line to {self._config.port} broke: {reason}"
            items.append(self._fault("unplugged", text, now_ns, now_ns))
        self.close()
        self._feed("link", b"down")
        self._open_due_ns = now_ns + round(self._back_off_s * 1e9)
        return items

    def _send(self, packet: bytes) -> None:
        assert self._serial is not None
        self._feed("tx", packet)
        with suppress(OSError):  # a full or broken line shows itself when reading
            os.write(self._serial.fileno(), packet)

    def _feed(self, direction: Direction, data: bytes) -> list[Item]:
        monotonic_ns, unix_ns = self._time.now()
        frame = RawFrame(monotonic_ns, unix_ns, direction, data)
        self._raw.append(frame)
        return self._decoder.feed(frame)

    # --- loss and recovery -------------------------------------------------------------------

    def _fault(self, kind: str, text: str, since_ns: int, now_ns: int) -> Event:
        self._trouble = (kind, since_ns)
        return Event(kind, text, now_ns, "error", {"port": self._config.port})

    def _recovered(self) -> Event:
        assert self._trouble is not None
        (kind, since_ns), self._trouble = self._trouble, None
        now_ns = time.monotonic_ns()
        seconds = (now_ns - since_ns) / 1e9
        text = f"samples again after {seconds:.2f} s ({kind})"
        return Event("recovered", text, now_ns, "info", {"fault": kind, "seconds": seconds})

    def _quiet_ns(self) -> int:
        return time.monotonic_ns() - self._quiet_since_ns

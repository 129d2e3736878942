"""The part of a driver around its decoder: records the raw frames and watches the line.

`SerialShell` adds a serial port that may vanish. Nothing here knows the meaning of bytes; a decoder
never sees a port.
"""

from __future__ import annotations

import os
import select
import termios
import time
from abc import ABC, abstractmethod
from collections import deque
from contextlib import suppress
from typing import Generic, Protocol, TypeVar

import serial

from armd.drivers.host_time import HostTime
from armd.drivers.line_health import SILENCE_NS, STALE_NS, LineHealth
from armd.drivers.sample import RAW_FRAMES_KEPT, Direction, Item, RawFrame


class Decoder(Protocol):
    """Turns frames into items, and does nothing else: it has no port and no clock."""

    @property
    def accepted(self) -> bool:
        """Whether the connected arm is the expected one."""
        ...

    @property
    def last_sample_ns(self) -> int | None:
        """The arrival of the last sample, host monotonic."""
        ...

    @property
    def counters(self) -> dict[str, int]: ...

    def warm_up(self) -> None:
        """Compile the decoder, or load it from the cache, before the first sample arrives."""
        ...

    def feed(self, frame: RawFrame) -> list[Item]: ...

    def preamble(self) -> list[RawFrame]: ...


D = TypeVar("D", bound=Decoder)


class Shell(ABC, Generic[D]):
    """The common part of all drivers; see `armd.drivers.sample.Driver`."""

    def __init__(self, decoder: D, name: str, renew_ns: int, channel: str = "serial") -> None:
        """Take the *name* of the line for messages, and the *channel* for its frames."""
        self._decoder = decoder
        self._line = LineHealth(name, renew_ns)
        self._channel = channel
        self._time = HostTime()
        self._raw: deque[RawFrame] = deque(maxlen=RAW_FRAMES_KEPT)

    @property
    def connected(self) -> bool:
        return self._decoder.accepted and self._without_sample_ns < SILENCE_NS

    @property
    def stale(self) -> bool:
        return not self._decoder.accepted or self._without_sample_ns > STALE_NS

    @property
    def _without_sample_ns(self) -> int:
        return time.monotonic_ns() - (self._decoder.last_sample_ns or 0)

    @property
    def hindrance(self) -> str:
        return ""

    @property
    def counters(self) -> dict[str, int]:
        return {**self._decoder.counters, "reconnects": self._line.reconnects}

    def open(self) -> None:
        """Prepare the driver; the first `read` opens the line, and tries again after a failure."""
        self._decoder.warm_up()

    @abstractmethod
    def close(self) -> None: ...

    def take_raw(self) -> list[RawFrame]:
        raw = list(self._raw)
        self._raw.clear()
        return raw

    def preamble(self) -> list[RawFrame]:
        return self._decoder.preamble()

    def _frame(self, direction: Direction, data: bytes) -> RawFrame:
        """Return *data* as a frame of this instant."""
        monotonic_ns, unix_ns = self._time.now()
        return RawFrame(monotonic_ns, unix_ns, direction, data, self._channel)

    def _take(self, frame: RawFrame) -> list[Item]:
        """Record *frame*, then decode it."""
        self._raw.append(frame)
        return self._decoder.feed(frame)

    def _feed(self, direction: Direction, data: bytes) -> list[Item]:
        return self._take(self._frame(direction, data))


class SerialShell(Shell[D]):
    """A driver of a serial port: `_try_open` opens it, `_receive` reads it.

    The `read` of a derived driver calls both. pyserial opens and configures the port. Then bytes
    are read from its descriptor: all that are there at once.
    """

    READ_BYTES = 1 << 16
    RENEW_NS = 1_000_000_000  # a port that stays silent is reopened this often
    DOWN = b"down"  # the "link" frame of a port that is closed

    def __init__(self, decoder: D, port: str, channel: str = "serial") -> None:
        super().__init__(decoder, port, self.RENEW_NS, channel)
        self._path = port
        self._unsent = 0  # requests that the line did not take completely
        self._port: serial.Serial | None = None
        self._poll = select.poll()

    @property
    def counters(self) -> dict[str, int]:
        return {**super().counters, "unsent": self._unsent}

    def close(self) -> None:
        if self._port is not None:
            with suppress(OSError):
                self._poll.unregister(self._port.fileno())
            with suppress(OSError):
                self._port.close()
            self._port = None

    @abstractmethod
    def _try_open(self, now_ns: int) -> list[Item]:
        """Call `_open_port`, and do what this line needs at its start."""

    @abstractmethod
    def _received(self, port: serial.Serial, data: bytes) -> list[Item]:
        """Handle the bytes that have come."""

    def _open_port(self, baud: int, now_ns: int) -> list[Item]:
        """Set `_port`, or leave it None and return an event, unless the fault is known already."""
        try:
            self._port = serial.Serial(self._path, baud, timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:  # SerialException is an OSError
            text = f"{self._path} does not open: {error}; `armd doctor` says why"
            return self._line.lost("port_missing", text, now_ns)
        with suppress(OSError, ValueError):  # a pty has no such mode
            self._port.set_low_latency_mode(True)
        self._poll.register(self._port.fileno(), select.POLLIN)
        return []

    def _renew(self) -> list[Item]:
        """Reopen a silent port.

        The adapter may hang, or its name may now mean another device.
        """
        self._hang_up()
        now_ns = time.monotonic_ns()
        return [*self._line.silent(now_ns, self._of_silence), *self._try_open(now_ns)]

    @property
    def _of_silence(self) -> str:
        """The text that a driver adds to the event of silence."""
        return ""

    def _unplugged(self, reason: str) -> list[Item]:
        self._hang_up()
        text = f"the line to {self._path} broke: {reason}"
        return self._line.lost("unplugged", text, time.monotonic_ns())

    def _hang_up(self) -> None:
        self.close()
        self._feed("link", self.DOWN)

    def _receive(self, port: serial.Serial) -> list[Item]:
        try:
            data = os.read(port.fileno(), self.READ_BYTES)
        except BlockingIOError:
            return []
        except OSError as error:
            return self._unplugged(str(error))
        return self._received(port, data) if data else self._unplugged("end of file")

    def _write(self, port: serial.Serial, data: bytes) -> RawFrame | None:
        """Send *data*; return the frame for the decoder.

        None where the line did not take all of it: then nothing counts as sent, and no answer
        comes.
        """
        frame = self._frame("tx", data)
        try:
            written = os.write(port.fileno(), data)
        except OSError:  # a full or broken line shows itself when reading
            written = 0
        if written < len(data):
            self._unsent += 1
            return None
        return frame

"""What a session with a MicroScribe consists of, step by step, and what the next request is.

The steps depend on the bytes alone: the driver sends what `request` says, tells when it has
waited long enough, and a replay takes the same steps from the recorded frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum, auto

from armd.drivers.microscribe import wire
from armd.drivers.sample import RawFrame


class Phase(Enum):
    SYNC = auto()  # IMMC until it comes back
    BEGIN = auto()
    SERIAL_NUMBER = auto()
    MAXIMA = auto()
    POLL = auto()


_BYTES = {
    Phase.SYNC: wire.SYNC,
    Phase.BEGIN: wire.BEGIN,
    Phase.SERIAL_NUMBER: bytes([wire.SERIAL_NUMBER]),
    Phase.MAXIMA: bytes([wire.MAXIMA]),
}


class Conversation:
    """Feed it the line's frames; it yields replies, each with the request that it answers."""

    def __init__(self) -> None:
        self.phase = Phase.SYNC
        self.pending: RawFrame | None = None  # the request that is not answered yet
        self.malformed = 0
        self._buffer = b""
        self._poll = 0  # which of wire.POLLS
        self._unanswered = 0  # polls in a row, before any was answered

    def restart(self) -> None:
        """Another line, or the same one anew: the arm waits for IMMC."""
        self.phase, self.pending, self._buffer = Phase.SYNC, None, b""
        self._poll = self._unanswered = 0

    @property
    def request(self) -> bytes:
        """What is to be sent next."""
        return _BYTES.get(self.phase) or bytes([wire.POLLS[self._poll]])

    @property
    def reply_size(self) -> int:
        """Bytes that a poll is answered with."""
        return wire.standard_size(wire.POLLS[self._poll])

    def sent(self, frame: RawFrame) -> Iterator[tuple[bytes, RawFrame]]:
        """A request goes out; what the one before has got is its reply, whole or not."""
        yield from self._take(complete=True)
        if self.pending is not None and self.phase is Phase.POLL:
            self.malformed += bool(self._buffer)
            self._unanswered += 1
            if self._unanswered == 3:
                self._poll = (self._poll + 1) % len(wire.POLLS)
                self._unanswered = 0
        self.pending, self._buffer = frame, b""

    def received(self, frame: RawFrame) -> Iterator[tuple[bytes, RawFrame]]:
        """Bytes came."""
        if self.pending is None:
            return  # nobody has asked: late, or noise
        self._buffer += frame.data
        yield from self._take(complete=False)

    def _take(self, complete: bool) -> Iterator[tuple[bytes, RawFrame]]:
        if self.pending is None or not self.pending.data:
            return
        request = self.pending
        if request.data in (wire.SYNC, wire.BEGIN):
            self._greet(request.data)
            return
        packet, rest = wire.take(request.data[0], self._buffer, complete)
        if packet is None:
            return
        self.pending, self._buffer = None, b""
        self.malformed += bool(rest)
        if self.phase is Phase.POLL:
            self._unanswered = -(1 << 31)  # this poll works; silence from now on is silence
        yield packet, request
        if packet[0] == wire.SERIAL_NUMBER:
            self.phase = Phase.MAXIMA
        elif packet[0] == wire.MAXIMA:
            self.phase = Phase.POLL

    def _greet(self, request: bytes) -> None:
        expected = wire.SYNC if request == wire.SYNC else wire.GREETING
        if expected in self._buffer:
            self.pending, self._buffer = None, b""
            self.phase = Phase.BEGIN if request == wire.SYNC else Phase.SERIAL_NUMBER

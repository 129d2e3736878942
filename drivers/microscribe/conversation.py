"""The steps of a session with a MicroScribe, and the next request.

The steps depend only on the bytes: the driver sends `request`, and sends the next one when it has
waited long enough. So a replay takes the same steps from the recorded frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum, auto

from armd.drivers.microscribe import wire
from armd.drivers.microscribe.stream import PacketStream, Streamed
from armd.drivers.sample import RawFrame


class Phase(Enum):
    SYNC = auto()  # send IMMC until the arm echoes it
    BEGIN = auto()
    SERIAL_NUMBER = auto()
    MAXIMA = auto()
    POLL = auto()
    STARTING = auto()  # command to stream sent, not acknowledged yet
    STREAM = auto()
    STOPPING = auto()  # command to stop sent


#: The phases of a session that has begun.
SESSION = (Phase.POLL, Phase.STARTING, Phase.STREAM, Phase.STOPPING)
_BYTES = {
    Phase.SYNC: wire.SYNC,
    Phase.BEGIN: wire.BEGIN,
    Phase.SERIAL_NUMBER: bytes([wire.SERIAL_NUMBER]),
    Phase.MAXIMA: bytes([wire.MAXIMA]),
}
_PHASES = {wire.STOP[0]: Phase.STOPPING, wire.RESPOND_TO_MOTION: Phase.STARTING}
ATTEMPTS = 3  # to start streaming, in a row


class Conversation:
    """Takes the line's frames; yields replies with their requests, and streamed readings."""

    def __init__(self) -> None:
        self._malformed = 0
        self.stream: PacketStream | None = None
        self.restart()

    def restart(self) -> None:
        """Begin again on another line, or after a reconnection: the arm waits for IMMC."""
        self.phase = Phase.SYNC
        self.pending: RawFrame | None = None  # the request that is not answered yet
        self._malformed, self.stream = self.malformed, None
        self.polled = 0  # readings requested and received since it last streamed
        self.failures = 0  # failed attempts in a row to start streaming
        self.stops = False  # STOP was acknowledged in this session
        self.unstopped = 0  # number of STOPs without answer, before the first answered one
        self._buffer = b""
        self._poll = 0  # index into wire.POLLS
        self._unanswered = 0  # polls in a row without answer, before the first answered one

    @property
    def request(self) -> bytes:
        """The next request to send; in a session, a poll."""
        return _BYTES.get(self.phase) or bytes([wire.POLLS[self._poll]])

    @property
    def reply_size(self) -> int:
        """The number of bytes in the reply to a poll."""
        return wire.get_standard_size(wire.POLLS[self._poll])

    @property
    def timed(self) -> bool:
        """Whether the arm sends its timer."""
        return bool(wire.POLLS[self._poll] & wire.TIME)

    @property
    def malformed(self) -> int:
        return self._malformed + (self.stream.malformed if self.stream is not None else 0)

    def sent(self, frame: RawFrame) -> Iterator[tuple[bytes, RawFrame]]:
        """Record a request; the bytes since the one before are that one's reply, even if
        incomplete.
        """
        yield from self._take(complete=True)
        if self.pending is not None and self.phase is Phase.POLL:
            self._malformed += bool(self._buffer)
            self._unanswered += 1
            if self._unanswered == 3:
                self._poll = (self._poll + 1) % len(wire.POLLS)
                self._unanswered = 0
        self._leave_stream()
        self.pending, self._buffer = frame, b""
        if self.phase in SESSION:
            self.phase = _PHASES.get(frame.data[0], Phase.POLL)

    def received(self, frame: RawFrame) -> Iterator[tuple[bytes, RawFrame | Streamed]]:
        """Take received bytes; yield replies and streamed readings."""
        if self.phase is Phase.STREAM and self.stream is not None:
            yield from self._streamed(frame)
        if self.pending is None:
            return  # no request is open: late bytes, or noise
        self._buffer += frame.data
        yield from self._take(complete=False)
        if self.phase is Phase.STARTING:
            _, acknowledged, behind = self._buffer.partition(bytes([wire.RESPOND_TO_MOTION]))
            if acknowledged:
                self.stream = PacketStream(self.pending.data)
                self.pending, self._buffer, self.phase = None, b"", Phase.STREAM
                yield from self._streamed(frame._replace(data=behind))

    def resume(self, stream: PacketStream) -> None:
        """Continue in the middle of a stream, as a recording may begin there."""
        self.stream, self.phase, self.pending, self.stops = stream, Phase.STREAM, None, True

    def _streamed(self, frame: RawFrame) -> Iterator[tuple[bytes, Streamed]]:
        assert self.stream is not None
        for reading in self.stream.push(frame):
            yield reading.packet, reading
        if self.stream.packets:
            self.failures = 0

    def _leave_stream(self) -> None:
        if self.phase is Phase.STARTING or (self.stream is not None and not self.stream.packets):
            self.failures += 1
        self.unstopped += self.phase is Phase.STOPPING and not self.stops
        if self.stream is not None:
            self._malformed += self.stream.malformed
            self.stream, self.polled = None, 0

    def _take(self, complete: bool) -> Iterator[tuple[bytes, RawFrame]]:
        if self.pending is None or not self.pending.data or self.phase is Phase.STARTING:
            return
        request = self.pending
        if request.data in (wire.SYNC, wire.BEGIN):
            self._greet(request.data)
            return
        packet, behind = wire.take(request.data[0], self._buffer, complete)
        if packet is None:
            return
        self.pending, self._buffer = None, b""
        self._malformed += bool(behind)
        if behind and self.phase is Phase.POLL and request.data[0] in wire.POLLS:
            return  # an extra byte, perhaps within: unreliable
        if self.phase is Phase.STOPPING:
            self.phase, self.stops = Phase.POLL, True
        elif self.phase is Phase.POLL:
            self._unanswered = -(1 << 31)  # this poll works: never try another one
            self.polled += request.data[0] in wire.POLLS
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

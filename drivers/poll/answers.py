"""What has come for the request that is out, and how long more is waited for. No port, no clock."""

from __future__ import annotations

from armd.drivers.poll.decoder import ServoDecoder
from armd.drivers.poll.exchange import Exchange
from armd.drivers.sample import RawFrame

#: Nothing has come at all: a busy host, or a line that is silent.
FIRST_BYTE_NS = 50_000_000
#: Answers have begun to come, then no more: three times what they were ever late, within these.
PAUSE_LEAST_NS, PAUSE_MOST_NS = 5_000_000, 30_000_000
#: All but those that have not answered for some cycles have.
ACCUSTOMED_NS = 1_000_000
EXCESS_KEPT = 0.998  # of what answers were late, from cycle to cycle
ASLEEP = 0.9  # of the time that answers need on the line at least, nobody listens for them


class Answers:
    """Of one line; `begin` with each request."""

    def __init__(self, decoder: ServoDecoder) -> None:
        self._decoder = decoder
        self._excess_ns = PAUSE_MOST_NS / 3  # how much longer than the line needs answers take
        self._needs_ns = 0.0  # what the exchange needs on the line, at least
        self._heard_ns = 0  # its last bytes; 0: none yet
        self._undecoded: list[RawFrame] = []
        self._bytes = b""  # of these

    def begin(self, exchange: Exchange) -> None:
        """The request of *exchange* went out."""
        decoder, request = self._decoder, exchange.request
        n_bytes = len(exchange.sent.data) + len(request.ids) * decoder.family.answer_bytes(request)
        gaps_ns = sum(decoder.pauses.before_ns(request, decoder.roster.version))
        self._needs_ns = n_bytes * decoder.byte_ns + gaps_ns
        self._heard_ns = 0

    def look_ns(self, exchange: Exchange) -> int:
        """Before this nobody needs to listen."""
        return exchange.sent.monotonic_ns + round(ASLEEP * self._needs_ns)

    def end_ns(self, exchange: Exchange) -> int:
        """When no more answers are waited for."""
        due_ns = exchange.sent.monotonic_ns + self._needs_ns
        given_up = self._decoder.roster.given_up
        if exchange.request.is_single and exchange.is_cycle and self._heard_ns == 0:
            is_expected = not given_up(exchange.request.ids[0])
            return round(
                due_ns + (PAUSE_MOST_NS if is_expected else self._excess_ns + ACCUSTOMED_NS)
            )
        if exchange.answers and all(map(given_up, exchange.missing)):
            return round(max(due_ns, self._heard_ns) + ACCUSTOMED_NS)
        if self._heard_ns == 0:
            return round(due_ns) + FIRST_BYTE_NS
        pause_ns = min(max(3 * self._excess_ns, PAUSE_LEAST_NS), PAUSE_MOST_NS)
        return round(max(due_ns, self._heard_ns) + pause_ns)

    def are_completed_by(self, data: bytes, exchange: Exchange) -> bool:
        """Whether *data* are the last answers, as can be told at a glance."""
        data = self._bytes + data
        return self._decoder.family.completes(data, exchange.request, exchange.missing)

    def add(self, frame: RawFrame) -> None:
        self._undecoded.append(frame)
        self._bytes += frame.data
        self._heard_ns = frame.monotonic_ns

    def may_be_all(self, exchange: Exchange) -> bool:
        """Whether as many bytes have come as the answers have that are still expected."""
        given_up = self._decoder.roster.given_up
        expected = sum(not given_up(servo) for servo in exchange.missing)
        return len(self._bytes) >= expected * self._decoder.family.answer_bytes(exchange.request)

    def take(self) -> list[RawFrame]:
        """What has come since the last time, to be decoded: all at once, as each look takes time
        while answers come in."""
        frames, self._undecoded, self._bytes = self._undecoded, [], b""
        return frames

    def note_complete(self, exchange: Exchange) -> None:
        """All have come: how much later than the line's own time."""
        excess_ns = self._heard_ns - exchange.sent.monotonic_ns - self._needs_ns
        self._excess_ns = max(excess_ns, self._excess_ns * EXCESS_KEPT)

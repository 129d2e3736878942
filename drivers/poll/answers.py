"""Collects the answers to the open request, and decides how long to wait for more; no port, no
clock.
"""

from __future__ import annotations

from armd.drivers.poll.decoder import ServoDecoder
from armd.drivers.poll.exchange import Exchange
from armd.drivers.sample import RawFrame

#: Wait for the first byte: the host may be busy, or the line silent.
FIRST_BYTE_NS = 50_000_000
#: Wait for further answers: three times their largest lateness, within these limits.
PAUSE_LEAST_NS, PAUSE_MOST_NS = 5_000_000, 30_000_000
#: Wait when all have answered except servos that have not answered for some cycles.
ACCUSTOMED_NS = 1_000_000
EXCESS_KEPT = 0.998  # factor of the lateness, from cycle to cycle
ASLEEP = 0.9  # do not listen during this part of the time that the answers need


class Answers:
    """The answers on one line; call `begin` with each request."""

    def __init__(self, decoder: ServoDecoder) -> None:
        self._decoder = decoder
        self._excess_ns = PAUSE_MOST_NS / 3  # lateness of answers, beyond the time on the line
        self._needs_ns = 0.0  # the least time of the exchange on the line
        self._heard_ns = 0  # arrival of its last bytes; 0: none yet
        self._undecoded: list[RawFrame] = []
        self._bytes = b""  # bytes of these frames

    def begin(self, exchange: Exchange) -> None:
        """Begin to wait: the request of *exchange* was sent."""
        decoder, request = self._decoder, exchange.request
        n_bytes = len(exchange.sent.data) + len(request.ids) * decoder.family.answer_bytes(request)
        gaps_ns = sum(decoder.pauses.before_ns(request, decoder.roster.version))
        self._needs_ns = n_bytes * decoder.byte_ns + gaps_ns
        self._heard_ns = 0

    def look_ns(self, exchange: Exchange) -> int:
        """Return when to begin to listen for answers."""
        return exchange.sent.monotonic_ns + round(ASLEEP * self._needs_ns)

    def end_ns(self, exchange: Exchange) -> int:
        """Return the time at which to stop waiting for answers."""
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
        """Return whether *data* are the last answers, by a quick check."""
        data = self._bytes + data
        return self._decoder.family.completes(data, exchange.request, exchange.missing)

    def add(self, frame: RawFrame) -> None:
        self._undecoded.append(frame)
        self._bytes += frame.data
        self._heard_ns = frame.monotonic_ns

    def may_be_all(self, exchange: Exchange) -> bool:
        """Return whether there are as many bytes as the expected answers have."""
        given_up = self._decoder.roster.given_up
        expected = sum(not given_up(servo) for servo in exchange.missing)
        return len(self._bytes) >= expected * self._decoder.family.answer_bytes(exchange.request)

    def take(self) -> list[RawFrame]:
        """Return the frames since the last call, to be decoded.

        All are decoded at once, because decoding takes time while answers come in.
        """
        frames, self._undecoded, self._bytes = self._undecoded, [], b""
        return frames

    def note_complete(self, exchange: Exchange) -> None:
        """Record the lateness of a complete exchange."""
        excess_ns = self._heard_ns - exchange.sent.monotonic_ns - self._needs_ns
        self._excess_ns = max(excess_ns, self._excess_ns * EXCESS_KEPT)

"""Estimates when each reading was made, and how many are missing before it.

A reading's instant is the middle of the interval in which it was made. A requested reading was made
between the end of its request and the beginning of its reply. A streamed reading was made within
its tick of the arm's timer (1.1 ms), and before it was received. Requested readings have mapped
that timer to the host's clock.
"""

from __future__ import annotations

from typing import Any

from armd.drivers.microscribe import wire
from armd.drivers.microscribe.stream import Streamed
from armd.drivers.microscribe.timer import TICK_NS, Timer
from armd.drivers.sample import RawFrame
from armd.drivers.serial.clock import PROMISED_NS

GAP_NS = 50_000_000  # gap when streaming starts again; after a longer one some are missing


class ReadingInstants:
    """The instants of one arm's readings, in their order."""

    def __init__(self) -> None:
        self.baud = wire.BAUDS[0]
        self.timer = Timer()
        self._last_ns = 0  # instant of the last sample
        self._pace_ns = 0.0  # pace of its stream; 0: it was requested
        self._paced = True  # bytes take time on the line, but not on a pseudo-terminal

    def restart(self) -> None:
        """Begin another session, perhaps of another arm on another line."""
        self.timer, self._paced = Timer(), True

    def estimate_instant(
        self, request: RawFrame, reply: RawFrame, size: int, ticks: int | None, maps: bool
    ) -> tuple[int, bool]:
        """Estimate the instant of a requested reading, and whether a stamp may rely on it.

        *size*: bytes of the reply; *ticks*: the timer in it; *maps*: use it to map the timer to the
        host's clock.
        """
        begin_ns, end_ns = self._between(request, reply, size)
        if maps and ticks is not None:
            self.timer.add_exchange(begin_ns, end_ns, self.timer.ticks(ticks, end_ns))
        holds = end_ns - begin_ns <= 2 * PROMISED_NS
        return max((begin_ns + end_ns) // 2, self._last_ns + 1), holds

    def streamed(self, streamed: Streamed, pace_ticks: float | None) -> tuple[int, bool] | None:
        """Estimate the instant of a streamed reading, and whether the timer was compared lately.

        *pace_ticks*: the interval of the stream, if known. None: it cannot have been made in its
        tick.
        """
        latest_ns = streamed.heard.monotonic_ns - self._line_ns(len(streamed.packet))
        ticks = self.timer.ticks(streamed.ticks, latest_ns)
        at_ns = self.timer.instant_ns(ticks, latest_ns)
        if at_ns is None or at_ns <= self._last_ns:
            return None
        if pace_ticks is not None:
            self._pace_ns = pace_ticks * TICK_NS
        return at_ns, self.timer.holds(ticks)

    def missing(self, at_ns: int) -> int:
        """Return how many readings are missing before that of *at_ns*.

        A stream also pauses for a few requested readings: then none is missing.
        """
        gap_ns = at_ns - self._last_ns
        return round(gap_ns / self._pace_ns) - 1 if self._pace_ns and gap_ns > GAP_NS else 0

    def stream_ended(self) -> None:
        """Record that the next reading was requested."""
        self._pace_ns = 0.0

    def note_sample(self, at_ns: int) -> None:
        """Record that the reading of *at_ns* became a sample."""
        self._last_ns = at_ns

    def state(self) -> list[Any]:
        """Return the state for `restore`, as JSON."""
        return [self._last_ns, self._pace_ns, self._paced, self.timer.state()]

    def restore(self, state: list[Any]) -> None:
        self._last_ns, self._pace_ns, self._paced, timer = state
        self.timer = Timer.restored(timer)

    def _between(self, request: RawFrame, reply: RawFrame, size: int) -> tuple[int, int]:
        """Return the instants of the request's last bit and the reply's first one.

        A reply that is quicker than its own bytes shows a line without pace; that is remembered.
        """
        begin = request.monotonic_ns + self._line_ns(len(request.data))
        end = reply.monotonic_ns - self._line_ns(size)
        if end < begin:
            self._paced = False
            begin, end = request.monotonic_ns, reply.monotonic_ns
        return begin, end

    def _line_ns(self, size: int) -> int:
        """Return the time of *size* bytes on the line."""
        return size * (10_000_000_000 // self.baud) if self._paced else 0

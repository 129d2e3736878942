"""When each reading was made, and how many are missing before it.

A reading's instant is the middle of where it must lie: if it was asked for, between the end of its
request and the beginning of its reply; if the arm sent it by itself, within its tick of the arm's
timer (1.1 ms), which such requests have mapped to the host's clock, and before it was heard.
"""

from __future__ import annotations

from typing import Any

from armd.drivers.microscribe import wire
from armd.drivers.microscribe.stream import Streamed
from armd.drivers.microscribe.timer import TICK_NS, Timer
from armd.drivers.sample import RawFrame
from armd.drivers.serial.clock import PROMISED_NS

GAP_NS = 50_000_000  # between two readings, when streaming begins anew; beyond it some are missing


class ReadingInstants:
    """Of one arm's readings, in their order."""

    def __init__(self) -> None:
        self.baud = wire.BAUDS[0]
        self.timer = Timer()
        self._last_ns = 0  # of the last sample
        self._pace_ns = 0.0  # of the stream that it was of; 0: it was asked for
        self._paced = True  # bytes take their time; not so on a pseudo-terminal

    def restart(self) -> None:
        """Another session, perhaps another arm on another line."""
        self.timer, self._paced = Timer(), True

    def estimate_instant(
        self, request: RawFrame, reply: RawFrame, size: int, ticks: int | None, maps: bool
    ) -> tuple[int, bool]:
        """Of a reading whose reply has *size* bytes, and whether it is as certain as a stamp has to
        be; *ticks* of the timer that it holds, if it *maps* that to the host's clock."""
        begin_ns, end_ns = self._between(request, reply, size)
        if maps and ticks is not None:
            self.timer.add_exchange(begin_ns, end_ns, self.timer.ticks(ticks, end_ns))
        holds = end_ns - begin_ns <= 2 * PROMISED_NS
        return max((begin_ns + end_ns) // 2, self._last_ns + 1), holds

    def streamed(self, streamed: Streamed, pace_ticks: float | None) -> tuple[int, bool] | None:
        """Of a reading that the arm sent by itself, every *pace_ticks* if that is known, and
        whether the timer was compared lately; None: it cannot have been made then."""
        latest_ns = streamed.heard.monotonic_ns - self._line_ns(len(streamed.packet))
        ticks = self.timer.ticks(streamed.ticks, latest_ns)
        at_ns = self.timer.instant_ns(ticks, latest_ns)
        if at_ns is None or at_ns <= self._last_ns:
            return None
        if pace_ticks is not None:
            self._pace_ns = pace_ticks * TICK_NS
        return at_ns, self.timer.holds(ticks)

    def missing(self, at_ns: int) -> int:
        """Readings that a broken stream did not bring before that of *at_ns*; it pauses for a few
        that are asked for, and then none is missing."""
        gap_ns = at_ns - self._last_ns
        return round(gap_ns / self._pace_ns) - 1 if self._pace_ns and gap_ns > GAP_NS else 0

    def stream_ended(self) -> None:
        """The next reading was asked for."""
        self._pace_ns = 0.0

    def note_sample(self, at_ns: int) -> None:
        """The reading of *at_ns* became a sample."""
        self._last_ns = at_ns

    def state(self) -> list[Any]:
        """For `restore`, as JSON."""
        return [self._last_ns, self._pace_ns, self._paced, self.timer.state()]

    def restore(self, state: list[Any]) -> None:
        self._last_ns, self._pace_ns, self._paced, timer = state
        self.timer = Timer.restored(timer)

    def _between(self, request: RawFrame, reply: RawFrame, size: int) -> tuple[int, int]:
        """The request's last bit and the reply's first one. A reply that is quicker than its own
        bytes tells of a line without pace, and nothing contradicts that later."""
        begin = request.monotonic_ns + self._line_ns(len(request.data))
        end = reply.monotonic_ns - self._line_ns(size)
        if end < begin:
            self._paced = False
            begin, end = request.monotonic_ns, reply.monotonic_ns
        return begin, end

    def _line_ns(self, size: int) -> int:
        """What so many bytes take on the line."""
        return size * (10_000_000_000 // self.baud) if self._paced else 0

"""The uncertainty of a cycle's instants, from the lateness of its answers.

If the host or the adapter paused, it may have been before the request was sent or after the answers
arrived.
"""

from __future__ import annotations

from collections import deque

#: An adapter delays less than this: it works at intervals of 1 ms, or of an eighth of that, and
#: requests wait for one interval, answers for another.
IN_DOUBT_NS = 2_000_000.0
REMEMBERED = 101  # number of cycles; the quickest twentieth shows whether the line has a pace


class Lateness:
    """The time by which answers arrive later than the line needs.

    An instant is the middle of the interval that request and answers allow. So it is uncertain by
    half of the lateness, even where every cycle is equally late: a constant delay may be before the
    servos or behind them.
    """

    def __init__(self) -> None:
        self.seen_ns: deque[int] = deque(maxlen=REMEMBERED)  # lateness of the last cycles

    def add(self, late_ns: int) -> None:
        """Record the lateness of a cycle."""
        self.seen_ns.append(late_ns)

    def doubt_ns(self, late_ns: int) -> float:
        """Return the uncertainty of a cycle's instants; 0 within an adapter's own time.

        *late_ns*: lateness of its answers, already added to `seen_ns`. On a line whose bytes take
        no time (a pseudo-terminal), answers usually arrive before the line's own time, so that time
        bounds nothing.
        """
        usual_ns = sorted(self.seen_ns)[len(self.seen_ns) // 20]
        doubt_ns = (late_ns - min(0, usual_ns)) / 2
        return doubt_ns if doubt_ns > IN_DOUBT_NS else 0.0

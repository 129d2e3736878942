"""By how much the instants of a cycle are in doubt: where the host or the adapter stood still,
nobody can tell whether it was before the request went out or after the answers were here."""

from __future__ import annotations

from collections import deque

#: An adapter's own time is less: it delivers at intervals of 1 ms, or of an eighth of that;
#: requests wait for one of them, and answers for another.
IN_DOUBT_NS = 2_000_000.0
REMEMBERED = 101  # cycles of which the quickest twentieth tell whether the line has a pace


class Lateness:
    """How much later than the line needs the answers are here. An instant lies in the middle of
    what request and answers allow, so it is in doubt by half of that, even where every cycle is as
    late: a delay that is always the same may still be before the servos or behind them."""

    def __init__(self) -> None:
        self.seen_ns: deque[int] = deque(maxlen=REMEMBERED)  # of the last cycles

    def add(self, late_ns: int) -> None:
        """The answers of a cycle came so late."""
        self.seen_ns.append(late_ns)

    def doubt_ns(self, late_ns: int) -> float:
        """By how much the instants of a cycle are in doubt whose answers came *late_ns* after the
        line's own time, which has been `seen`; 0 within an adapter's own time.

        On a line whose bytes take no time (a pseudo-terminal) answers are usually here before
        that: there its own time bounds nothing.
        """
        usual_ns = sorted(self.seen_ns)[len(self.seen_ns) // 20]
        doubt_ns = (late_ns - min(0, usual_ns)) / 2
        return doubt_ns if doubt_ns > IN_DOUBT_NS else 0.0

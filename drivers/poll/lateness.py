"""By how much the instants of a cycle are in doubt: where the host stood still, nobody can tell
whether it was before the request went out or after the answers were here."""

from __future__ import annotations

from collections import deque

#: Adapters deliver at intervals of 1 ms, or of an eighth of that; requests wait for one of them,
#: and answers for another.
JITTER_NS = 2_000_000.0
REMEMBERED = 101  # cycles of which the quickest twentieth tell what is usual, on a busy host too


class Lateness:
    """How much later than the line needs the answers are here where nobody disturbs them (an
    adapter's own time, the same in each cycle), and how much later than that those of one cycle
    were."""

    def __init__(self) -> None:
        self.seen_ns: deque[int] = deque(maxlen=REMEMBERED)  # of the last cycles

    def seen(self, late_ns: int) -> None:
        """The answers of a cycle came so late."""
        self.seen_ns.append(late_ns)

    def doubt_ns(self, late_ns: int) -> float:
        """By how much the instants of a cycle are in doubt whose answers came *late_ns* after the
        line's own time, which has been `seen`; 0 within an adapter's jitter."""
        usual_ns = sorted(self.seen_ns)[len(self.seen_ns) // 20]
        return max(0.0, late_ns - usual_ns - JITTER_NS)

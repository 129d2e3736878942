"""When each servo of a cycle answered: from the line's arithmetic and the answers' arrival.

Servos answer one after the other, each in a slot of its own. What arrives is batched by USB, so
arrivals only bound the slots from above; the last one anchors them. A servo's position is taken
to be that at the beginning of its own answer: when exactly a servo samples is documented nowhere;
at the most it is one slot earlier, and one run of the servo's own 1 ms loop.

Where the host stood still, nobody can tell whether it was before the request went out or after the
answers were here. `Lateness` tells by how much the instants of such a cycle are in doubt.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

#: Adapters deliver at intervals of 1 ms, or of an eighth of that; requests wait for one of them,
#: and answers for another.
JITTER_NS = 2_000_000.0
REMEMBERED = 101  # cycles of which the quickest twentieth tell what is usual, on a busy host too


def instants(
    sent_ns: int,
    arrived_ns: Sequence[int | None],
    size_ns: float,
    gaps_ns: Sequence[float],
) -> list[float]:
    """The instant of each servo's position, in the order in which they were asked.

    *sent_ns*: when the request went out; *arrived_ns*: of each answer's last byte, None for one
    that did not come (its slot is skipped; one must have come); *size_ns*: how long an answer
    takes; *gaps_ns*: the pause before each.
    """
    last = max(j for j, arrived in enumerate(arrived_ns) if arrived is not None)
    end: float = max(arrived for arrived in arrived_ns if arrived is not None)
    anchor = end
    begins = [anchor] * len(arrived_ns)
    for j in range(last, -1, -1):
        arrived = arrived_ns[j]
        if arrived is None:
            begins[j] = end
            continue
        begins[j] = min(end, arrived) - size_ns
        end = begins[j] - gaps_ns[j]
    # A line faster than it claims to be (a pseudo-terminal): within what is known for certain.
    early = sent_ns - begins[0]
    if early > 0:
        shrink = (anchor - sent_ns) / (anchor - begins[0])
        begins = [anchor - (anchor - begin) * shrink for begin in begins]
    return begins


class Lateness:
    """How much later than the line needs the answers are here where nobody disturbs them (an
    adapter's own time, the same in each cycle), and how much later than that those of one cycle
    were."""

    def __init__(self) -> None:
        self.seen_ns: deque[int] = deque(maxlen=REMEMBERED)  # of the last cycles

    def doubt_ns(self, late_ns: int) -> float:
        """By how much the instants of a cycle are in doubt whose answers came *late_ns* after the
        line's own time; 0 within an adapter's jitter."""
        self.seen_ns.append(late_ns)
        usual_ns = sorted(self.seen_ns)[len(self.seen_ns) // 20]
        return max(0.0, late_ns - usual_ns - JITTER_NS)

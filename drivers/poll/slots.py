"""When each servo of a cycle answered: from the line's arithmetic and the answers' arrival.

Servos answer one after the other, each in a slot of its own. What arrives is batched by USB, so
arrivals only bound the slots from above; the last one anchors them. A servo's position is taken
to be that at the beginning of its own answer: when exactly a servo samples is documented nowhere;
at the most it is one slot earlier, and one run of the servo's own 1 ms loop.
"""

from __future__ import annotations

from collections.abc import Sequence


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

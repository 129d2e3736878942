"""Assembles one reading of every joint for each SYNC, and never mixes two cycles.

The order of frames on the bus decides. A frame that a node sends between two SYNCs belongs to the
first of them, unless the node was late. So a SYNC waits until all answers to the last one are
there, or too late ever to come. Where another node produces SYNC, the cycles after a missing answer
are withheld for as long.
"""

from __future__ import annotations

from dataclasses import dataclass, field

LATE_MOST_NS = 100_000_000  # no answer to a SYNC comes later than this


@dataclass(frozen=True, slots=True)
class EncoderReading:
    position: int  # counts, as the encoder sends them
    alarms: int


@dataclass(slots=True)
class SyncCycle:
    """The readings of the joints since one SYNC."""

    number: int
    latch_ns: int  # host monotonic, instant of the SYNC
    readings: dict[int, EncoderReading] = field(default_factory=dict)  # by joint, from 1
    complete: bool = False


class CycleAssembler:
    """Takes SYNCs and readings in bus order; a cycle is complete when its last joint reports.

    `incomplete` counts cycles in which a joint was missing, `withheld` complete ones that might
    have been mixed, `repeated` second readings of a joint within a cycle.
    """

    def __init__(self) -> None:
        self.incomplete = self.withheld = self.repeated = 0
        self.reset()

    def reset(self) -> None:
        """Forget the present cycle, because the connection is another one."""
        self._cycle: SyncCycle | None = None
        self._doubtful_until_ns = 0

    def may_sync(self, now_ns: int) -> bool:
        """Return whether every answer to a SYNC sent now will be known to be its own."""
        cycle = self._cycle
        return cycle is None or cycle.complete or now_ns > cycle.latch_ns + LATE_MOST_NS

    def sync(self, number: int, latch_ns: int) -> None:
        """Begin a new cycle."""
        last, self._cycle = self._cycle, SyncCycle(number, latch_ns)
        if last is not None and not last.complete:
            self.incomplete += 1
            self._doubtful_until_ns = last.latch_ns + LATE_MOST_NS

    def report(
        self, joint: int, reading: EncoderReading, expected: frozenset[int]
    ) -> SyncCycle | None:
        """Add a reading; return the cycle if each *expected* joint has now reported once."""
        cycle = self._cycle
        if cycle is None:
            return None
        if joint in cycle.readings:  # nobody knows which of the two belongs to this SYNC
            self.repeated += 1
            self._doubtful_until_ns = cycle.latch_ns + LATE_MOST_NS
            return None
        cycle.readings[joint] = reading
        if cycle.complete or not expected <= cycle.readings.keys():
            return None
        cycle.complete = True
        if cycle.latch_ns < self._doubtful_until_ns:
            self.withheld += 1
            return None
        return cycle

"""One SYNC, one reading of every joint: never a reading of another cycle among them.

The order of frames on the bus decides: what a node sends between two SYNCs belongs to the first
of them, unless the node was late. A node that did not report in one cycle may report for it in
the next, so the next is not trusted either.
"""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class Reading:
    position: int  # counts, as the encoder says it
    alarms: int


@dataclass(slots=True)
class Cycle:
    """What the joints have said since one SYNC."""

    number: int
    latch_ns: int  # host monotonic, instant of the SYNC
    readings: dict[int, Reading] = field(default_factory=dict)  # by joint, from 1
    trusted: bool = True
    complete: bool = False


class CycleAssembler:
    """Feed SYNCs and readings in bus order; a cycle comes back when its last joint reports.

    `incomplete` counts cycles in which a joint was missing, `withheld` complete ones that might
    have been mixed, `repeated` second readings of a joint within a cycle.
    """

    def __init__(self) -> None:
        self.incomplete = self.withheld = self.repeated = 0
        self._cycle: Cycle | None = None

    def reset(self) -> None:
        self._cycle = None

    @property
    def waiting(self) -> bool:
        """Some joint has not reported since the last SYNC."""
        return self._cycle is not None and not self._cycle.complete

    def sync(self, number: int, latch_ns: int, expected: frozenset[int]) -> None:
        """A new cycle begins; *expected* are the joints that should have reported in the last."""
        last = self._cycle
        self._cycle = Cycle(number, latch_ns)
        if last is None:
            return
        self.incomplete += not last.complete
        self._cycle.trusted = expected <= last.readings.keys()

    def report(self, joint: int, reading: Reading, expected: frozenset[int]) -> Cycle | None:
        """The cycle, if with this every joint of *expected* has reported in it, exactly once."""
        cycle = self._cycle
        if cycle is None:
            return None
        if joint in cycle.readings:
            self.repeated += 1
            cycle.trusted = False  # which of the two belongs to this SYNC?
            return None
        cycle.readings[joint] = reading
        if cycle.complete or not expected <= cycle.readings.keys():
            return None
        cycle.complete = True
        if not cycle.trusted:
            self.withheld += 1
            return None
        return cycle

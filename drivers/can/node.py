"""One node of the bus as the decoder sees it: is it to be believed, and if not, why?"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from armd.drivers.can.objects import BOOT_UP, OPERATIONAL

HEARTBEAT_MS = 100
HEARTBEATS_MISSED = 3.5  # so many periods without one: the node is lost


class State(Enum):
    NEW = "not configured"
    READY = "configured, not heard yet"
    REPORTING = "reporting"
    FAULTY = "faulty"  # to be configured again


@dataclass(slots=True)
class Node:
    """Everything happens by the frames fed, so a replay sees the same."""

    number: int
    name: str  # "joint 3", "temperature module 0x20"
    state: State = State.NEW
    fault: str = ""
    range_counts: int = 0  # joints only
    counts_per_turn: int = 0
    _beat_cycle: int = 0  # cycle of the last heartbeat
    _value_cycle: int | None = None  # and of the last process value, where each cycle has one

    @property
    def wants_configuration(self) -> bool:
        return self.state in (State.NEW, State.FAULTY)

    @property
    def reporting(self) -> bool:
        return self.state is State.REPORTING

    def configured(self, cycle: int, every_cycle: bool) -> None:
        """Configured in *cycle*; *every_cycle*: a process value is due at each SYNC."""
        self.state = State.READY
        self._beat_cycle = cycle
        self._value_cycle = cycle if every_cycle else None

    def reported(self, cycle: int) -> bool:
        """A process value arrived; True if it is the first since the configuration."""
        if self._value_cycle is not None:
            self._value_cycle = cycle
        first = self.state is State.READY
        if first:
            self.state = State.REPORTING
        return first

    def heartbeat(self, nmt_state: int, cycle: int) -> str | None:
        """Returns what is wrong, if something new is."""
        self._beat_cycle = cycle
        if nmt_state == OPERATIONAL or self.wants_configuration:
            return None
        # The first heartbeat after the start command may still tell the state before it.
        if self.state is State.READY and nmt_state != BOOT_UP:
            return None
        return self.fail("it has restarted" if nmt_state == BOOT_UP else "it has left operation")

    def overdue(self, cycle: int, cycles_allowed: int) -> str | None:
        """Looked at in every cycle: has it been silent for too long?"""
        if self.wants_configuration:
            return None
        if cycle - self._beat_cycle > cycles_allowed:
            return self.fail("its heartbeat is lost")
        if self._value_cycle is not None and cycle - self._value_cycle > cycles_allowed:
            return self.fail("it sends no values")
        return None

    def fail(self, fault: str) -> str | None:
        """To be configured again; returns *fault* if it was not known."""
        if self.wants_configuration:
            return None
        self.state = State.FAULTY
        self.fault = fault
        return fault

"""One node of the bus as the decoder sees it: its state, and its fault if it has one."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass
from enum import Enum

from armd.drivers.can.objects import BOOT_UP, ENCODER_LAYOUT, OPERATIONAL, EncoderLayout

HEARTBEAT_MS = 100
PATIENCE_NS = 350_000_000  # a node without heartbeat or value for this long is lost


class NodeState(Enum):
    NEW = "not configured"
    READY = "configured, not heard yet"
    REPORTING = "reporting"
    FAULTY = "faulty"  # to be configured again


@dataclass(slots=True)
class Node:
    """The state of a node. Only the frames fed change it, so a replay sees the same."""

    number: int
    name: str  # "joint 3", "temperature module 0x20"
    _: KW_ONLY
    state: NodeState = NodeState.NEW
    fault: str = ""
    range_counts: int = 0  # joints only
    counts_per_turn: int = 0
    values_due: bool = True  # a value is due at every SYNC: joints
    warnings: int = 0  # joints only: object 6505
    layout: EncoderLayout = ENCODER_LAYOUT  # joints only: layout of TPDO1
    alarms: int = 0  # joints only: object 6503, where the layout has no alarms
    _beating: bool = False  # a heartbeat came since the configuration
    _beat_age_ns: int = 0  # since the last heartbeat
    _value_age_ns: int = 0  # since the last process value

    @property
    def wants_configuration(self) -> bool:
        return self.state in (NodeState.NEW, NodeState.FAULTY)

    @property
    def reporting(self) -> bool:
        return self.state is NodeState.REPORTING

    def configured(self) -> None:
        self.state = NodeState.READY
        self._beating = False
        self._beat_age_ns = self._value_age_ns = 0

    def reported(self) -> bool:
        """Record a process value; return True if the node is thereby in service (again)."""
        self._value_age_ns = 0
        if self.state is not NodeState.READY or not self._beating:
            return False
        self.state = NodeState.REPORTING
        return True

    def heartbeat(self, nmt_state: int) -> str | None:
        """Record a heartbeat; return a new fault, if there is one."""
        self._beat_age_ns = 0
        self._beating = nmt_state == OPERATIONAL
        if self._beating or self.wants_configuration:
            return None
        # The first heartbeat after the start command may still carry the state before it.
        if self.state is NodeState.READY and nmt_state != BOOT_UP:
            return None
        return self.fail("it has restarted" if nmt_state == BOOT_UP else "it has left operation")

    def grow_older(self, elapsed_ns: int) -> str | None:
        """Add the time since the last SYNC; return a fault if the node was silent for too long."""
        if self.wants_configuration:
            return None
        self._beat_age_ns += elapsed_ns
        self._value_age_ns += elapsed_ns
        if self._beat_age_ns > PATIENCE_NS:
            return self.fail("its heartbeat is lost")
        if self.values_due and self._value_age_ns > PATIENCE_NS:
            return self.fail("it sends no values")
        return None

    def fail(self, fault: str) -> str | None:
        """Mark the node for configuration; return *fault* if it was not reported yet."""
        if self.wants_configuration:
            return None
        news = self.state is NodeState.REPORTING or not self.fault
        self.state = NodeState.FAULTY
        self.fault = self.fault or fault
        return fault if news else None

    def bus_was_down(self) -> None:
        """Mark the node for configuration without a fault of its own."""
        if self.state is not NodeState.FAULTY:
            self.state = NodeState.NEW
            self.fault = ""

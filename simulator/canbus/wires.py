"""What carries CAN frames between the nodes and the host."""

from __future__ import annotations

import time
from typing import NamedTuple, Protocol


class Frame(NamedTuple):
    """A CAN data frame with an 11-bit identifier."""

    can_id: int
    data: bytes
    arrival_ns: int = 0  # CLOCK_MONOTONIC, of a frame received


def to_monotonic_ns(unix_ns: int) -> int:
    """The kernel's time stamp of an arrival (Unix time) on CLOCK_MONOTONIC, as of now."""
    return unix_ns - time.time_ns() + time.monotonic_ns()


class BusEnd(Protocol):
    """The nodes' end of a bus."""

    address: str  # what a person gives to the host to find it

    def receive(self, timeout_s: float) -> list[Frame]:
        """Frames of others; waits up to *timeout_s* for the first. Empty while down."""
        ...

    def send(self, frames: list[Frame]) -> None:
        """Put frames on the bus, in order; what nobody can take is lost, as on a bus."""
        ...

    def down(self) -> None:
        """The bus is gone: whoever uses it sees it fail or fall silent."""
        ...

    def up(self) -> None:
        """The bus is back, at the same address."""
        ...

    def close(self) -> None: ...

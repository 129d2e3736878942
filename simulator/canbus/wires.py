"""The wires that carry CAN frames between the nodes and the host."""

from __future__ import annotations

import time
from typing import NamedTuple, Protocol


class Frame(NamedTuple):
    """A CAN data frame with an 11-bit identifier."""

    can_id: int
    data: bytes
    arrival_ns: int = 0  # CLOCK_MONOTONIC, of a received frame


def to_monotonic_ns(unix_ns: int) -> int:
    """Convert the kernel's time stamp of an arrival (Unix time) to the present CLOCK_MONOTONIC."""
    return unix_ns - time.time_ns() + time.monotonic_ns()


class BusEnd(Protocol):
    """The nodes' end of a bus."""

    address: str  # the address for the host's configuration

    def receive(self, timeout_s: float) -> list[Frame]:
        """Return frames of others; wait up to *timeout_s* for the first. Empty while down."""
        ...

    def send(self, frames: list[Frame]) -> None:
        """Put frames on the bus, in order; frames that nobody receives are lost."""
        ...

    def down(self) -> None:
        """Take the bus down: its users see it fail or become silent."""
        ...

    def up(self) -> None:
        """Bring the bus back, at the same address."""
        ...

    def close(self) -> None: ...

"""The arm at any instant: CAN nodes latch when a SYNC arrives, not on a grid."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from armd.arrays import F64
from armd.simulator.live.physics import Block

GRID_HZ = 1000


@dataclass(frozen=True)
class Instant:
    """The true state at one instant: encoders, sensors, and the tip."""

    encoder_rad: F64  # (N,)
    tip_mm: F64  # (3,)
    sensor_c: F64  # (S,)


class Timeline:
    """Blocks of physics on a grid of `GRID_HZ`, interpolated between its points.

    Linear interpolation has an error of 0.25 µm for a tip that accelerates at 2 m/s².
    """

    def __init__(self, blocks: Iterator[Block]) -> None:
        self._blocks = blocks
        self._first = 0
        self._block = next(blocks)
        self._next = next(blocks)

    def advance_to(self, time_s: float) -> Instant:
        """Return a later instant; one before the present block counts as its start."""
        place = max(time_s * GRID_HZ - self._first, 0.0)
        while place >= len(self._block.tip_mm):
            place -= len(self._block.tip_mm)
            self._first += len(self._block.tip_mm)
            self._block, self._next = self._next, next(self._blocks)
        row = int(place)
        share = place - row
        return Instant(
            self._between("encoder_rad", row, share),
            self._between("tip_mm", row, share),
            self._block.felt_c(row),
        )

    def _between(self, name: str, row: int, share: float) -> F64:
        values: F64 = getattr(self._block, name)
        after: F64 = values[row + 1] if row + 1 < len(values) else getattr(self._next, name)[0]
        between: F64 = (1 - share) * values[row] + share * after
        return between

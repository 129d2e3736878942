"""Blocks of physics with their encoder counts; the next one is prepared in pieces."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from armd.simulator.live.electronics import Electronics
from armd.simulator.live.physics import Block

Counts = npt.NDArray[np.uint32]


class BlockBuffer:
    """The current block, with its range of latches, and the next one, prepared in part."""

    def __init__(self, blocks: Iterator[Block], electronics: Electronics) -> None:
        self._blocks = blocks
        self._electronics = electronics
        self._next: Block | None = None
        self._next_counts: Counts | None = None
        self.first_k = self.end_k = 0
        self.take()

    @property
    def prepared(self) -> bool:
        """Whether `take` needs no further work."""
        return self._next_counts is not None

    @property
    def middle_k(self) -> int:
        """The latch halfway through the current block."""
        return (self.first_k + self.end_k) // 2

    def prepare(self) -> None:
        """Do one piece of work for the next block, short enough to fit between two latches."""
        if self._next is None:
            self._next = next(self._blocks)
        elif self._next_counts is None:
            self._next_counts = self._electronics.counts(self._next.encoder_rad)

    def take(self) -> None:
        """Make the next block the current one."""
        while self._next is None or self._next_counts is None:
            self.prepare()
        self.block, self.counts = self._next, self._next_counts  # counts (n, N)
        self._next = self._next_counts = None
        self.first_k, self.end_k = self.end_k, self.end_k + len(self.block.buttons)

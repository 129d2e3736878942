"""The host's two clocks, read at the same instant."""

from __future__ import annotations

import time

TOGETHER_NS = 20_000  # readings further apart were interrupted: their offset is not used


class HostTime:
    """CLOCK_MONOTONIC and Unix time of one instant; the difference follows a stepped wall clock."""

    def __init__(self) -> None:
        self._unix_minus_monotonic_ns = time.time_ns() - time.monotonic_ns()

    def now(self) -> tuple[int, int]:
        """Return (monotonic_ns, unix_ns) of this instant."""
        before = time.monotonic_ns()
        unix = time.time_ns()
        took_ns = time.monotonic_ns() - before
        if took_ns < TOGETHER_NS:
            self._unix_minus_monotonic_ns = unix - before - took_ns // 2
        return before, before + self._unix_minus_monotonic_ns

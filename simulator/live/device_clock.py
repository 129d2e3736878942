"""The arm's own clock: a crystal with an error, and its deadlines on the host."""

from __future__ import annotations

import time
from contextlib import suppress
from pathlib import Path


class DeviceClock:
    """A clock with latch k at k / rate_hz, which runs *ppm* parts per million fast.

    Deadlines are absolute: lateness of one never shifts the next.
    """

    def __init__(self, rate_hz: int, ppm: float) -> None:
        self.ppm = ppm
        self.rate_hz = rate_hz
        self._host_ns_per_latch = 1e9 / (rate_hz * (1 + ppm * 1e-6))
        self._start_ns = 0

    def start(self) -> None:
        """Start with latch 0 now."""
        self._start_ns = time.monotonic_ns()

    def instant_ns(self, latch: int) -> int:
        """Return the host's CLOCK_MONOTONIC at a latch."""
        return self._start_ns + round(latch * self._host_ns_per_latch)

    def latches_by(self, monotonic_ns: int) -> int:
        """Return how many latches are due by an instant, including latch 0."""
        return int((monotonic_ns - self._start_ns) / self._host_ns_per_latch) + 1

    def device_us(self, monotonic_ns: int) -> int:
        """Return the device's clock at an instant, µs since latch 0."""
        return int((monotonic_ns - self._start_ns) * (1 + self.ppm * 1e-6) / 1000)

    def latch_us(self, latch: int) -> int:
        """Return the device's clock at a latch, µs since latch 0."""
        return latch * 1_000_000 // self.rate_hz


def set_precise_timers() -> None:
    """Wake at deadlines, not up to 50 µs later, as Linux does to save power."""
    with suppress(OSError):  # a kernel without the file keeps deadlines less well
        Path("/proc/self/timerslack_ns").write_text("1")

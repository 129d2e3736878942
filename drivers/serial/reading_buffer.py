"""Keeps readings until the arm is identified; then they are delivered or dropped."""

from __future__ import annotations

from collections import deque

from armd.drivers.serial.sequence import Rows
from armd.drivers.serial.wire import TemperatureReading

HELD_SAMPLES = 8192  # the oldest are dropped first

HeldReading = Rows | TemperatureReading


class ReadingBuffer:
    """Readings with their arrival, host monotonic and Unix ns."""

    def __init__(self) -> None:
        self._readings: deque[tuple[HeldReading, int, int]] = deque()
        self._weight = 0

    def add(self, reading: HeldReading, arrival_ns: int, unix_ns: int) -> int:
        """Add a reading; return how many packets were dropped for it."""
        self._readings.append((reading, arrival_ns, unix_ns))
        self._weight += count_packets(reading)
        before = self._weight
        while self._weight > HELD_SAMPLES:
            self._weight -= count_packets(self._readings.popleft()[0])
        return before - self._weight

    def take(self) -> list[tuple[HeldReading, int, int]]:
        """Return all readings, and keep none."""
        readings = list(self._readings)
        self.forget()
        return readings

    def forget(self) -> int:
        """Drop all readings; return how many packets they were."""
        dropped, self._weight = self._weight, 0
        self._readings.clear()
        return dropped


def count_packets(reading: HeldReading) -> int:
    """Return the number of packets in *reading*."""
    return 1 if isinstance(reading, TemperatureReading) else len(reading)

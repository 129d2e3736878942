"""The servos' own temperatures: read twice a second, told when they change."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from armd.arrays import F64

FRESH_NS = 2_500_000_000  # a temperature that was not read for longer is none
RESOLUTION_C = 1.0


class Warmth:
    """Sensor k is the own thermometer of servo ids[k-1]."""

    def __init__(self, ids: Sequence[int]) -> None:
        self._ids = ids
        self._read: dict[int, tuple[float, int]] = {}  # °C, when
        self._told: list[float] = []

    def take(self, servo: int, celsius: float, now_ns: int) -> None:
        self._read[servo] = celsius, now_ns

    def reading(self, silent: set[int], now_ns: int, again: bool) -> F64 | None:
        """All sensors (S,) °C, NaN of those that are *silent* or not known; None if that was told
        before and need not be told *again*."""
        if not self._ids:
            return None
        celsius = [self._celsius(servo, silent, now_ns) for servo in self._ids]
        if not again and _same(celsius, self._told):
            return None
        self._told = celsius
        return np.array(celsius)

    def _celsius(self, servo: int, silent: set[int], now_ns: int) -> float:
        celsius, at_ns = self._read.get(servo, (math.nan, 0))
        return celsius if servo not in silent and now_ns - at_ns <= FRESH_NS else math.nan

    def state(self) -> list[tuple[int, float, int]]:
        return [(servo, celsius, at_ns) for servo, (celsius, at_ns) in self._read.items()]

    def restore(self, state: list[tuple[int, float, int]]) -> None:
        self._read = {servo: (celsius, at_ns) for servo, celsius, at_ns in state}


def _same(a: list[float], b: list[float]) -> bool:
    """As far as they are numbers, and where they are not."""
    if len(a) != len(b):
        return False
    return all(x == y or (math.isnan(x) and math.isnan(y)) for x, y in zip(a, b, strict=True))

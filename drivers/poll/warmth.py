"""The servos' own temperatures: read twice a second, told when they change.

Of two servos with one id the second may answer after the first was taken for the only one: so what
a cycle brings is believed at the next, unless it was contradicted meanwhile.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Sequence

import numpy as np

from armd.arrays import F64

FRESH_NS = 2_500_000_000  # a temperature that was not read for longer is none
RESOLUTION_C = 1.0


class Warmth:
    """Sensor k is the own thermometer of servo ids[k-1]."""

    def __init__(self, ids: Sequence[int]) -> None:
        self._ids = ids
        self._said: dict[int, float] = {}  # °C, in the cycle before
        self._read: dict[int, tuple[float, int]] = {}  # °C, when
        self._told: list[float] = []

    def hear(self, servo: int, celsius: float) -> None:
        """What it said in this cycle."""
        self._said[servo] = celsius

    def reading(self, silent: Container[int], doubtful: Container[int], now_ns: int) -> F64 | None:
        """All sensors (S,) °C, after the next cycle has been heard and before it is told: NaN of
        those that are *silent* in it, *doubtful* or not known; None if that was told before."""
        again = bool(self._said)
        if not self._ids or not (again or self._read):
            return None
        for servo, celsius in self._said.items():
            if servo not in doubtful:
                self._read[servo] = celsius, now_ns
        self._said.clear()
        celsius_all = [
            math.nan if servo in silent or servo in doubtful else self._celsius(servo, now_ns)
            for servo in self._ids
        ]
        if not again and _same(celsius_all, self._told):
            return None
        self._told = celsius_all
        return np.array(celsius_all)

    def _celsius(self, servo: int, now_ns: int) -> float:
        celsius, at_ns = self._read.get(servo, (math.nan, 0))
        return celsius if now_ns - at_ns <= FRESH_NS else math.nan

    def state(self) -> list[tuple[int, float, int]]:
        return [(servo, celsius, at_ns) for servo, (celsius, at_ns) in self._read.items()]

    def unproven(self) -> list[tuple[int, float]]:
        return list(self._said.items())

    def restore(
        self, state: Iterable[tuple[int, float, int]], unproven: Iterable[tuple[int, float]]
    ) -> None:
        """As `state` and `unproven` gave it, through JSON."""
        self._read = {servo: (celsius, at_ns) for servo, celsius, at_ns in state}
        self._said = dict(unproven)


def _same(a: list[float], b: list[float]) -> bool:
    """As far as they are numbers, and where they are not."""
    if len(a) != len(b):
        return False
    return all(x == y or (math.isnan(x) and math.isnan(y)) for x, y in zip(a, b, strict=True))

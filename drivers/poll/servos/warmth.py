"""The servos' own temperatures: read twice a second, reported when they change.

If two servos have one id, the second may answer after the first was taken for the only one. So a
temperature is used one cycle later, unless it was contradicted meanwhile.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Sequence
from typing import Any

import numpy as np

from armd.drivers.sample import Event, Item, Temperatures

FRESH_NS = 2_500_000_000  # an older temperature counts as missing
RESOLUTION_C = 1.0
#: The plausible range, °C: both makers put the limit at which a servo switches off within it.
#: Outside, a thermometer is broken, or colder than the byte can express.
COLDEST_C, HOTTEST_C = 0.0, 100.0
ABSURD_NS = 5_000_000_000  # implausible values are reported again after this time without one


class Warmth:
    """The sensors of a line; sensor k is the thermometer of servo ids[k-1]."""

    def __init__(self, ids: Sequence[int], name: Callable[[int], str], register: str) -> None:
        """Take the *name* of a servo, and of the *register* of its temperature, for events."""
        self._ids = ids
        self._name = name
        self._register = register
        self._reported_c: dict[int, float] = {}  # °C, in the cycle before
        self._read: dict[int, tuple[float, int]] = {}  # °C, when
        self._absurd_ns: dict[int, int] = {}  # servos with implausible values, and when last
        self._last_c: list[float] = []

    def hear(self, servo: int, celsius: float) -> None:
        """Record the temperature of this cycle."""
        self._reported_c[servo] = celsius

    def reading(
        self,
        silent: Container[int],
        doubtful: Container[int],
        now_ns: int,
        unix_minus_monotonic_ns: int,
    ) -> list[Item]:
        """Return all sensors, after an event for each that has become implausible.

        It is called when the next cycle has been received. NaN stands for servos that are *silent*
        in it, *doubtful*, not known or implausible. Nothing is returned if that was reported
        before.
        """
        again = bool(self._reported_c)
        if not self._ids or not (again or self._read):
            return []
        items: list[Item] = []
        for servo, celsius in self._reported_c.items():
            if servo not in doubtful:
                self._read[servo] = celsius, now_ns
                items += self._doubt(servo, celsius, now_ns)
        self._reported_c.clear()
        celsius_all = [
            math.nan if servo in silent or servo in doubtful else self._celsius(servo, now_ns)
            for servo in self._ids
        ]
        if not again and _same(celsius_all, self._last_c):
            return items
        self._last_c = celsius_all
        stamp_ns = now_ns + unix_minus_monotonic_ns
        return [
            *items, Temperatures(np.array(celsius_all), now_ns, now_ns, stamp_ns, RESOLUTION_C)
        ]  # fmt: skip

    def _celsius(self, servo: int, now_ns: int) -> float:
        celsius, at_ns = self._read.get(servo, (math.nan, 0))
        return celsius if now_ns - at_ns <= FRESH_NS and _believable(celsius) else math.nan

    def _doubt(self, servo: int, celsius: float, now_ns: int) -> list[Event]:
        last_ns = self._absurd_ns.get(servo)
        if _believable(celsius):
            if last_ns is not None and now_ns - last_ns > ABSURD_NS:
                del self._absurd_ns[servo]
            return []
        self._absurd_ns[servo] = now_ns
        if last_ns is not None or servo not in self._ids:
            return []
        difference = f"found {celsius:.0f}, expected {COLDEST_C:.0f} to {HOTTEST_C:.0f} °C"
        text = f"{self._name(servo)}: {self._register}: {difference}; it counts as missing"
        return [Event("temperature_absurd", text, now_ns, "warning", {"servo": servo})]

    def state(self) -> dict[str, Any]:
        """Return the state for `restore` in a replay, as JSON."""
        return {
            "warmth": [(servo, celsius, at_ns) for servo, (celsius, at_ns) in self._read.items()],
            "unproven": list(self._reported_c.items()),
            "absurd": list(self._absurd_ns.items()),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from *state*."""
        self._read = {servo: (celsius, at_ns) for servo, celsius, at_ns in state["warmth"]}
        self._reported_c = dict(state.get("unproven", ()))  # older recordings lack these
        self._absurd_ns = dict(state.get("absurd", ()))


def _believable(celsius: float) -> bool:
    return COLDEST_C <= celsius <= HOTTEST_C


def _same(a: list[float], b: list[float]) -> bool:
    """Return whether two readings are equal, NaN counting as equal to NaN."""
    if len(a) != len(b):
        return False
    return all(x == y or (math.isnan(x) and math.isnan(y)) for x, y in zip(a, b, strict=True))

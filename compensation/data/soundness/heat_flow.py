"""Detects impossible temperatures of a link: they leave and return faster than heat flows.

Examples are a sensor's power-on value (85 °C of a DS18B20), a dead conversion or a loose plug: one
or a few readings differ from others that agree. Between them a link would have to warm and cool
faster than air, sun or a hand makes it. They are no temperatures and count as missing.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64, Mask

#: The shortest time constant with which a link approaches the temperature of its surroundings: a
#: carbon tube of 1.5 mm (1.9 kJ/m²K) in a draught (20 W/m²K) takes 95 s; 3 mm of aluminium take
#: minutes.
FASTEST_S = 90.0
#: The largest difference between the surroundings and a link: sun, a chamber, winter air. Together
#: with `FASTEST_S` this is 0.44 K/s at first; full sun (1 kW/m²) on that tube gives 0.5 K/s.
MOST_DRIVING_K = 40.0
#: A smaller step is never called impossible: a servo's whole degrees, clocks that are off, a finger
#: on the sensor. Live, flag 3 reports such a step.
LEAST_K = 6.0
#: Readings that all lie within this range have no jump, however they are rounded.
NO_JUMP_K = 0.999 * LEAST_K
#: A live sensor that stays at its new value is believed after this time: it may have been moved.
SETTLED_S = 5.0
#: The number of histories of one sensor that are followed at once, each consistent in itself.
MOST_HISTORIES = 8


def compute_reachable_k(seconds: F64) -> F64:
    """Return the largest change (n,) K of a link's temperature in *seconds* (n,); NaN:
    not known.
    """
    reach = MOST_DRIVING_K * -np.expm1(-np.abs(seconds) / FASTEST_S)
    return np.maximum(np.where(np.isnan(reach), MOST_DRIVING_K, reach), LEAST_K)


def _jumps(value: F64, time: F64) -> I64:
    """Return the indices of readings that heat flow cannot reach from the one before."""
    steps = np.flatnonzero(np.abs(np.diff(value)) > LEAST_K)  # no less is impossible
    reach_k = compute_reachable_k(time[steps + 1] - time[steps])
    jumps: I64 = steps[np.abs(value[steps + 1] - value[steps]) > reach_k] + 1
    return jumps


@dataclass
class History:
    """A course of one sensor's readings that a link can have had: its end and its length."""

    last_c: float
    last_s: float
    n: int = 0

    def reaches(self, celsius: float, time_s: float) -> bool:
        """Return whether heat flow can lead from its end to a reading."""
        apart_k = abs(celsius - self.last_c)
        if apart_k <= LEAST_K:
            return True
        return apart_k <= float(compute_reachable_k(np.array(time_s - self.last_s)))


class SensorHeat:
    """The histories of one sensor so far, for readings that come in pieces."""

    def __init__(self, usual_c: float) -> None:
        """Start without histories.

        Of two histories of equal length, the one that ends nearer to *usual_c* is believed.
        """
        self._usual_c = usual_c
        self._histories: list[History] = []

    def impossible(self, celsius: F64, time_s: F64) -> Mask:
        """Return which of the next readings (n,) °C, at (n,) s, are no temperature of a link.

        They are in the order of the table: readings in any order are compared by the time between
        them. The longest history that a link can have had is believed; all other readings are not.
        """
        bad = np.zeros(len(celsius), dtype=bool)
        if not len(celsius):
            return bad
        finite: I64 | slice = slice(None)
        span_k = float(celsius.max() - celsius.min())
        if not math.isfinite(span_k):
            finite = np.flatnonzero(np.isfinite(celsius))
            if not len(finite):
                return bad
        value, time = celsius[finite], time_s[finite]
        jumps = [] if span_k <= NO_JUMP_K else _jumps(value, time).tolist()
        edges = [0, *jumps, len(value)]
        owners = [self._extend(value[a:b], time[a:b]) for a, b in itertools.pairwise(edges)]
        believed = max(self._histories, key=lambda h: (h.n, -abs(h.last_c - self._usual_c)))
        if len(owners) == 1 and owners[0] is believed:
            return bad
        bad[finite] = np.repeat([owner is not believed for owner in owners], np.diff(edges))
        return bad

    def _extend(self, value: F64, time: F64) -> History:
        """Add consecutive readings to the longest history that leads to them."""
        first_c, first_s = float(value[0]), float(time[0])
        before = [history for history in self._histories if history.reaches(first_c, first_s)]
        history = max(before, key=lambda h: h.n) if before else History(first_c, first_s)
        history.last_c, history.last_s = float(value[-1]), float(time[-1])
        history.n += len(value)
        other_histories = sorted(
            (h for h in self._histories if h is not history), key=lambda h: -h.n
        )
        self._histories = [*other_histories[: MOST_HISTORIES - 1], history]
        return history


class LiveSensor:
    """The streaming form: each reading is judged when it arrives, from earlier ones."""

    def __init__(self, usual_c: float) -> None:
        """Start at *usual_c*, the assumed temperature of a link before its first reading."""
        self._usual_c = usual_c
        self._believed: tuple[float, float] = usual_c, -math.inf  # °C, s
        self._since_s = math.nan  # start of the believed course
        self._doubted: tuple[float, float, float] | None = None  # °C, s, since s

    def believe(self, celsius: float, time_s: float) -> bool:
        """Return whether a reading in °C is a temperature that a link can have.

        A jump is not believed, unless it stays for `SETTLED_S`. A jump of more than
        `MOST_DRIVING_K` is then believed only if the course before it lasted no longer than that. A
        first value is replaced at once by one nearer to the usual temperature.
        """
        if self._leads_to(*self._believed, celsius, time_s):
            self._since_s = time_s if math.isnan(self._since_s) else self._since_s
        elif (since_s := self._jumped(celsius, time_s)) is not None:
            self._since_s = since_s
        else:
            return False
        self._believed, self._doubted = (celsius, time_s), None
        return True

    def _jumped(self, celsius: float, time_s: float) -> float | None:
        """Return the instant (s) from which a jump is believed; None if it is not."""
        believed_c, last_s = self._believed
        apart_k = abs(celsius - believed_c)
        is_short = not last_s - self._since_s > SETTLED_S
        is_first = is_short and not math.isnan(self._since_s)
        if is_first and abs(celsius - self._usual_c) < abs(believed_c - self._usual_c):
            return time_s
        doubted = self._doubted
        if doubted is None or not self._leads_to(*doubted[:2], celsius, time_s):
            doubted = celsius, time_s, time_s
        self._doubted = celsius, time_s, doubted[2]
        may_stay = is_short or apart_k <= MOST_DRIVING_K
        return doubted[2] if may_stay and time_s - doubted[2] >= SETTLED_S else None

    @staticmethod
    def _leads_to(from_c: float, from_s: float, to_c: float, to_s: float) -> bool:
        apart_k = abs(to_c - from_c)
        if apart_k <= LEAST_K:
            return True
        return apart_k <= MOST_DRIVING_K * -math.expm1(-abs(to_s - from_s) / FASTEST_S)

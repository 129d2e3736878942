"""Rates of change of temperatures: slopes over the last minute, and steps.

Of coarse temperatures, in steps such as whole degrees, only certain changes count.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64
from armd.compiled.jit import jit

#: Time over which a rate of change is judged, and the shortest time at first.
RATE_OVER_NS = 60_000_000_000
RATE_AFTER_NS = 3_000_000_000
#: A larger change between two readings is a step, independent of the slope.
STEP_K = 0.2
#: Time for coarse temperatures, longer because a degree takes a minute at the limit of 60 K/h.
COARSE_OVER_NS = 180_000_000_000
#: Least time between two coarse readings that are stored.
APART_NS = 250_000_000
#: Initial size of a history: a minute with four readings a second.
ROOM = 256


@dataclass(frozen=True)
class Drift:
    """The fastest change among the sensors in use, in K/h, and its standard error."""

    sensor: str
    k_per_h: float
    standard_error: float
    jump_k_per_h: float  # the fastest step of more than STEP_K between two readings; else 0

    def __str__(self) -> str:
        return f"{self.sensor} drifts by {self.k_per_h:+.1f} K/h"

    def exceeds(self, limit_k_per_h: float) -> bool:
        """Return whether it surely exceeds a limit: by a step, or by three standard errors."""
        return (
            self.jump_k_per_h > limit_k_per_h
            or abs(self.k_per_h) - 3 * self.standard_error > limit_k_per_h
        )


class RecentReadings:
    """The readings of the last RATE_OVER_NS, in arrays that are reused."""

    def __init__(self, sensors: Sequence[str]) -> None:
        self._sensors = sensors
        self._first, self._end = 0, 0
        self._times_ns = np.empty(ROOM, np.int64)
        self._celsius = np.empty((ROOM, len(sensors)))
        self._fastest_drift = np.empty(3)

    def __len__(self) -> int:
        return self._end - self._first

    def append(self, celsius: Sequence[float], monotonic_ns: int) -> None:
        """Add one reading of all sensors (S,), NaN before a sensor's first value.

        A reading with a time before the last one gets the last one's time.
        """
        if len(self):
            monotonic_ns = max(monotonic_ns, int(self._times_ns[self._end - 1]))
        if self._end == len(self._times_ns):
            self._make_room()
        self._times_ns[self._end] = monotonic_ns
        self._celsius[self._end] = celsius
        self._end += 1
        while self._times_ns[self._first] < monotonic_ns - RATE_OVER_NS:
            self._first += 1

    def fastest(self, used: I64) -> Drift | None:
        """Return the fastest drift of the sensors *used*; None for a short history."""
        rows = slice(self._first, self._end)
        worst = _fastest(self._times_ns[rows], self._celsius[rows], used, self._fastest_drift)
        if worst < 0:
            return None
        slope, error, jump = self._fastest_drift.tolist()
        return Drift(self._sensors[worst], slope, error, jump)

    def _make_room(self) -> None:
        """Move the readings to the front, of longer arrays if they fill more than half."""
        rows, n = slice(self._first, self._end), len(self)
        room = len(self._times_ns) * (2 if 2 * n > len(self._times_ns) else 1)
        times_ns, celsius = np.empty(room, np.int64), np.empty((room, len(self._sensors)))
        times_ns[:n], celsius[:n] = self._times_ns[rows], self._celsius[rows]
        self._times_ns, self._celsius = times_ns, celsius
        self._first, self._end = 0, n


class CoarseHistory:
    """The coarse readings (steps of a degree or similar) of the last COARSE_OVER_NS.

    Such a reading only shows that the temperature is within half a step of it. So one step, even a
    sudden one, is not a certain change; two readings more than a step apart are.
    """

    def __init__(self, sensors: Sequence[str], resolution_c: float) -> None:
        self._sensors = sensors
        self._resolution_c = resolution_c
        self._history: deque[tuple[int, list[float]]] = deque()

    def __len__(self) -> int:
        return len(self._history)

    def append(self, celsius: Sequence[float], monotonic_ns: int) -> None:
        """Add one reading of all sensors (S,), NaN before a sensor's first value."""
        now = monotonic_ns, list(celsius)
        if len(self._history) > 1 and monotonic_ns - self._history[-2][0] < APART_NS:
            self._history.pop()
        self._history.append(now)
        while self._history[0][0] < monotonic_ns - COARSE_OVER_NS:
            self._history.popleft()

    def fastest(self, used: I64) -> Drift | None:
        """Return the fastest drift of the sensors *used*; None for a short history."""
        if len(self._history) < 3 or self._history[-1][0] - self._history[0][0] < RATE_AFTER_NS:
            return None
        hours = np.array([at_ns for at_ns, _ in self._history]) / 3.6e12
        since = hours[-1] - hours[:-1]
        celsius = np.array([values for _, values in self._history])
        worst: Drift | None = None
        for sensor in used.tolist():
            change = celsius[-1, sensor] - celsius[:-1, sensor]
            if np.isnan(change).any():
                continue
            certain = float((np.maximum(np.abs(change) - self._resolution_c, 0.0) / since).max())
            if worst is None or certain > worst.jump_k_per_h:
                k_per_h = float(change[0] / since[0])
                error = float(self._resolution_c / since[0])
                worst = Drift(self._sensors[sensor], k_per_h, error, certain)
        return worst


@jit
def _fastest(times_ns: I64, celsius: F64, used: I64, drift: F64) -> int:
    """Return the sensor that changes fastest, or -1; *drift* gets slope, standard error, step.

    Slopes are least-squares fits to all n readings, in K/h; a sensor that lacks a reading does not
    count.
    """
    n, worst, highest = len(times_ns), -1, 0.0
    if n < 3 or times_ns[n - 1] - times_ns[0] < RATE_AFTER_NS:
        return worst
    mean_h, spread = 0.0, 0.0
    for i in range(n):
        mean_h += (times_ns[i] - times_ns[n - 1]) / 3.6e12 / n
    for i in range(n):
        spread += ((times_ns[i] - times_ns[n - 1]) / 3.6e12 - mean_h) ** 2
    for sensor in used:
        mean_c, slope, squares, jump = 0.0, 0.0, 0.0, 0.0
        for i in range(n):
            mean_c += celsius[i, sensor] / n
        if math.isnan(mean_c):
            continue
        for i in range(n):
            hours = (times_ns[i] - times_ns[n - 1]) / 3.6e12 - mean_h
            slope += hours * (celsius[i, sensor] - mean_c) / spread
        for i in range(n):
            hours = (times_ns[i] - times_ns[n - 1]) / 3.6e12 - mean_h
            squares += (celsius[i, sensor] - mean_c - slope * hours) ** 2
        error = math.sqrt(squares / (n - 2) / spread)
        for i in range(1, n):
            step = abs(celsius[i, sensor] - celsius[i - 1, sensor])
            if step > STEP_K:
                hours = (times_ns[i] - times_ns[i - 1]) / 3.6e12
                jump = max(jump, step / max(hours, 1e-12))  # a duplicate reading is not a step
        rate = max(abs(slope) - 3 * error, jump)
        if worst < 0 or rate > highest:
            worst, highest = sensor, rate
            drift[0], drift[1], drift[2] = slope, error, jump
    return worst

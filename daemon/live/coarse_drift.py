"""How fast temperatures change that are told in whole degrees: what is beyond doubt of it.

Such a reading says no more than that the temperature lies within half a step of it. So one step,
however sudden, is no change that anybody could swear to; two readings more than a step apart are.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np

from armd.arrays import I64
from armd.daemon.live.drift import RATE_AFTER_NS, Drift

#: Longer than for fine readings: at the limit of 60 K/h a degree takes a minute.
RATE_OVER_NS = 180_000_000_000
#: Readings that say the same are kept so far apart.
APART_NS = 250_000_000


class CoarseHistory:
    """The readings of the last RATE_OVER_NS; as `armd.daemon.live.drift.History`."""

    def __init__(self, sensors: Sequence[str], resolution_c: float) -> None:
        self._sensors = sensors
        self._resolution_c = resolution_c
        self._kept: deque[tuple[int, list[float]]] = deque()

    def __len__(self) -> int:
        return len(self._kept)

    def append(self, celsius: Sequence[float], monotonic_ns: int) -> None:
        """One reading of all sensors (S,), NaN before a sensor's first value."""
        now = monotonic_ns, list(celsius)
        if len(self._kept) > 1 and monotonic_ns - self._kept[-2][0] < APART_NS:
            self._kept.pop()
        self._kept.append(now)
        while self._kept[0][0] < monotonic_ns - RATE_OVER_NS:
            self._kept.popleft()

    def fastest(self, used: I64) -> Drift | None:
        """Of the sensors *used*; None while the history is too short to tell."""
        if len(self._kept) < 3 or self._kept[-1][0] - self._kept[0][0] < RATE_AFTER_NS:
            return None
        hours = np.array([at_ns for at_ns, _ in self._kept]) / 3.6e12
        since = hours[-1] - hours[:-1]
        celsius = np.array([values for _, values in self._kept])
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

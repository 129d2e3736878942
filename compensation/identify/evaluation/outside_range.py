"""Report readings warmer or colder than the temperatures of the calibration."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.data.tables.within import is_within
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration, list_used_sensors
from armd.terminal.counted import format_count

#: Sensors differ by this much; a link of 0.5 m expands by 6 µm at most.
LEAST_K = 0.5


class OutsideRange:
    """Counts readings outside the identified temperatures, session by session, in pieces."""

    def __init__(self, arm: Arm, calibration: Calibration | None) -> None:
        used = list_used_sensors(arm, calibration)
        ranges = calibration.temperature_range_c if calibration else {}
        self._columns = [
            (s, name, *ranges[name])
            for s, name in enumerate(arm.sensors)
            if name in used and name in ranges
        ]
        self._n: dict[int, int] = {}  # readings, by session
        self._names: dict[int, str] = {}
        #: number outside, lowest, highest
        self._outside: dict[tuple[int, int], tuple[int, float, float]] = {}

    def add(self, session: int, name: str, celsius: F64) -> None:
        """Add the next readings (n, S) °C of a session, NaN where missing."""
        self._names[session] = name
        self._n[session] = self._n.get(session, 0) + len(celsius)
        for s, _, low, high in self._columns:
            if is_within(celsius[:, s], low - LEAST_K, high + LEAST_K):
                continue
            values_c = celsius[np.isfinite(celsius[:, s]), s]
            outside = values_c[(values_c < low - LEAST_K) | (values_c > high + LEAST_K)]
            if len(outside):
                n, least_c, most_c = self._outside.get((session, s), (0, np.inf, -np.inf))
                self._outside[session, s] = (
                    n + len(outside), min(least_c, outside.min()), max(most_c, outside.max())
                )  # fmt: skip

    def in_words(self) -> list[str]:
        """Return a sentence for each session that has such readings."""
        sentences = []
        for session, name in self._names.items():
            words = [
                f"{sensor} {least_c:.1f} to {most_c:.1f} °C in {n}"
                f" (calibrated {low:.1f} to {high:.1f})"
                for s, sensor, low, high in self._columns
                if (session, s) in self._outside
                for n, least_c, most_c in [self._outside[session, s]]
            ]
            if words:
                readings = format_count(self._n[session], "reading")
                sentences.append(
                    f"{name}: temperatures outside the calibration's range, of {readings}:"
                    f" {', '.join(words)}; the model is extrapolated there."
                )
        return sentences

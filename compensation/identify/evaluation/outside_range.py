"""Readings warmer or colder than the calibration knows the arm: what is said of them."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration, used_sensors
from armd.terminal.counted import counted

#: Sensors read so far beside each other; a link of 0.5 m grows by 6 µm at most.
LEAST_K = 0.5


class OutsideRange:
    """Counts readings outside the identified temperatures, session by session, in pieces."""

    def __init__(self, arm: Arm, calibration: Calibration | None) -> None:
        used = used_sensors(arm, calibration)
        ranges = calibration.temperature_range_c if calibration else {}
        self._columns = [
            (s, name, *ranges[name])
            for s, name in enumerate(arm.sensors)
            if name in used and name in ranges
        ]
        self._n: dict[int, int] = {}  # readings, by session
        self._names: dict[int, str] = {}
        self._seen: dict[tuple[int, int], tuple[int, float, float]] = {}  # outside, lowest, highest

    def add(self, session: int, name: str, celsius: F64) -> None:
        """The next readings (n, S) °C of a session, NaN missing."""
        self._names[session] = name
        self._n[session] = self._n.get(session, 0) + len(celsius)
        for s, _, low, high in self._columns:
            known = celsius[np.isfinite(celsius[:, s]), s]
            outside = known[(known < low - LEAST_K) | (known > high + LEAST_K)]
            if len(outside):
                n, least, most = self._seen.get((session, s), (0, np.inf, -np.inf))
                self._seen[session, s] = (
                    n + len(outside), min(least, outside.min()), max(most, outside.max())
                )  # fmt: skip

    def in_words(self) -> list[str]:
        """A sentence for each session that has such readings."""
        sentences = []
        for session, name in self._names.items():
            words = [
                f"{sensor} {least:.1f} to {most:.1f} °C in {n} (calibrated {low:.1f} to {high:.1f})"
                for s, sensor, low, high in self._columns
                if (session, s) in self._seen
                for n, least, most in [self._seen[session, s]]
            ]
            if words:
                readings = counted(self._n[session], "reading")
                sentences.append(
                    f"{name}: temperatures outside the calibration's range, of {readings}:"
                    f" {', '.join(words)}; the model is extrapolated there."
                )
        return sentences

"""The temperature columns of readings, without impossible temperatures of links and artefacts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.data.sessions.columns import MemoryOrder, read_temperatures
from armd.compensation.data.soundness.heat_flow import SensorHeat
from armd.compensation.data.tables.readings import Readings, describe_row
from armd.compensation.model.arm import Arm

#: The most rows that one sentence names.
MOST_ROWS = 5


class TemperatureColumns:
    """Reads the temperatures of one table, piece by piece."""

    def __init__(self, arm: Arm, order: MemoryOrder = "C") -> None:
        self._order = order
        self._names = [*arm.sensors, "artefact_c"]
        self._heat = [SensorHeat(arm.reference_temperature_c) for _ in self._names]
        self._last_c = np.full(len(self._names), np.nan)

    def take(self, readings: Readings, time_s: F64, name: str) -> tuple[F64, F64, list[str]]:
        """Return temperatures of the sensors (n, S) and the artefact (n,) in °C, and remarks.

        NaN is missing. Impossible temperatures are missing, too; a remark names them by file and
        row.
        """
        celsius = read_temperatures(readings, self._names, self._order)
        remarks = []
        for column, heat in enumerate(self._heat):
            if not readings.has(self._names[column]):
                continue
            bad = np.flatnonzero(heat.impossible(celsius[:, column], time_s))
            if len(bad):
                read = celsius[bad, column]
                celsius[bad, column] = np.nan
                dropped = _Dropped(self._names[column], bad, read)
                around = _around(celsius[:, column], int(bad[0]), self._last_c[column])
                remarks.append(dropped.in_words(readings, name, around))
            if np.isfinite(celsius[-1, column]):
                self._last_c[column] = celsius[-1, column]
                continue
            finite = np.flatnonzero(np.isfinite(celsius[:, column]))
            if len(finite):
                self._last_c[column] = celsius[finite[-1], column]
        return celsius[:, :-1], celsius[:, -1], remarks


@dataclass(frozen=True)
class _Dropped:
    """Values of one sensor that are not used."""

    sensor: str
    rows: I64  # of the piece, from 0
    read_c: F64

    def in_words(self, readings: Readings, name: str, around_c: float) -> str:
        table = f"{name}/{readings.path.name}" if name else str(readings.path)
        first = describe_row(readings.path, readings.first_row + int(self.rows[0]))
        jump_k = abs(float(self.read_c[0]) - around_c)
        text = f"{table} {first}: {self.sensor} reads {self.read_c[0]:g} °C"
        if np.isfinite(jump_k):
            text += f", {jump_k:.0f} K from the readings before and after"
        if further_rows := [str(readings.first_row + int(row) + 1) for row in self.rows[1:]]:
            named = ", ".join(further_rows[: MOST_ROWS - 1]) + " …" * (
                len(further_rows) >= MOST_ROWS
            )
            text += f", and likewise in {len(further_rows)} more ({named})"
        return text + "; no link warms and cools so fast: the temperature counts as missing there."


def _around(celsius: F64, row: int, before_c: float) -> float:
    """Return the mean of the last value before and the first after *row*, °C; NaN if there is
    neither.
    """
    earlier, later = celsius[:row], celsius[row + 1 :]
    earlier, later = earlier[np.isfinite(earlier)], later[np.isfinite(later)]
    ends = [*(earlier[-1:] if len(earlier) else [before_c]), *later[:1]]
    finite = [end for end in ends if np.isfinite(end)]
    return float(np.mean(finite)) if finite else float("nan")

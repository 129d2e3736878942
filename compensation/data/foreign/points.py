"""Tables of points without joints, as an arm's own host writes them: x, y, z, and the target."""

from __future__ import annotations

import datetime
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from armd.arrays import F64
from armd.compensation.data.foreign.table import ForeignTable, read_table
from armd.compensation.data.foreign.times import check_unit, read_times
from armd.compensation.data.foreign.words import DATE, LENGTHS, WORDS, split_unit
from armd.errors import BadInput
from armd.terminal.suggest import format_names

AXES = ("x_mm", "y_mm", "z_mm")
TAKEN = (*AXES, "target", "placement")
TIMED = ("time_s", "date")
ALL = "1"


@dataclass(frozen=True)
class PointTable:
    """A table of n measured points."""

    position_mm: F64  # (n, 3)
    target: list[str]
    placement: list[str]
    time_s: list[float]  # NaN unknown; since *started*, or an unknown instant
    started: datetime.datetime | None
    remarks: list[str] = field(default_factory=list)  # assumptions, a sentence each


def read_points(path: Path, *, timed: bool = False) -> PointTable:
    """Read a table of points, with their instants if *timed*.

    Raises `BadInput` for a table without x, y, z, or with a cell that is not a number.
    """
    table = read_table(path)
    remarks = list(table.assumed)
    columns: dict[str, int] = {}
    for column, header in enumerate(table.header):
        word = split_unit(header)[0]
        name = "date" if word in DATE else header if header in TAKEN else WORDS.get(word)
        if name is None or name not in (*TAKEN, *(TIMED if timed else ())):
            continue
        if name in columns:
            actual = f"two columns, {table.header[columns[name]]!r} and {header!r}"
            raise BadInput(path, name, actual, "one")
        columns[name] = column
    for name in AXES:
        if name not in columns:
            expected = "columns x_mm, y_mm, z_mm"
            raise BadInput(
                path, name, f"no such column among {format_names(table.header)}", expected
            )
    position = np.column_stack([_millimetres(table, columns[name]) for name in AXES])
    names = {
        name: [row[columns[name]] for row in table.rows]
        if name in columns
        else [ALL] * len(table.rows)
        for name in ("target", "placement")
    }
    for name in ("target", "placement"):
        if "" in names[name]:
            raise table.fault(names[name].index(""), columns[name], f"the name of a {name}")
    remarks += [
        f"{name} is the column {table.header[column]!r}" for name, column in columns.items()
    ]
    time_s, started = _times(table, columns)
    return PointTable(position, names["target"], names["placement"], time_s, started, remarks)


def _times(
    table: ForeignTable, columns: dict[str, int]
) -> tuple[list[float], datetime.datetime | None]:
    """Return the time of each point, and the instant from which they count, if it is known."""
    column = columns.get("time_s", columns.get("date"))
    if column is None:
        return [float("nan")] * len(table.rows), None
    unit = split_unit(table.header[column])[1]
    check_unit(table, column, unit)
    day = columns.get("date") if "time_s" in columns else None
    times = read_times(table, column, unit, day, None)
    return times.seconds, times.started


def _millimetres(table: ForeignTable, column: int) -> list[float]:
    header = table.header[column]
    unit = split_unit(header)[1] or "mm"
    if unit not in LENGTHS:
        expected = f"one of {format_names(LENGTHS)}"
        raise BadInput(table.path, f"column {header}", f"the unit {unit!r}", expected)
    values = [LENGTHS[unit] * table.number(row, column) for row in range(len(table.rows))]
    for row, value in enumerate(values):
        if not np.isfinite(value):
            raise table.fault(row, column, "a number")
    return values

"""Two tables as one: joints as the arm's controller logged them, points as a tracker did."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.data.foreign.places import find_places
from armd.compensation.data.foreign.table import ForeignTable
from armd.compensation.data.foreign.times import OF_A_DAY, Times, check_unit, read_times
from armd.compensation.data.foreign.words import word_and_unit
from armd.compensation.data.session_columns import number_columns
from armd.compensation.model.arm import Arm
from armd.errors import BadInput
from armd.terminal.counted import counted
from armd.terminal.suggest import few

JoinBy = Literal["row", "time"]

#: A point belongs to the row of joints that is nearest in time, if it is no farther than this.
WITHIN_S = 0.5


def join_tables(
    joints: ForeignTable,
    points: ForeignTable,
    arm: Arm,
    by: JoinBy | None,
    within_s: float = WITHIN_S,
) -> ForeignTable:
    """Return one table with a row for each point: its row of joints, and its own columns.

    *by* "row": the tables have equal numbers of rows, in one order; "time": both have times of one
    clock, and a point takes the joints nearest in time, at most *within_s* s away. None: by time
    where both tables have times, else by row. Raises `BadInput`.
    """
    times = [_times(table, arm) for table in (joints, points)]
    known = [read for read, _ in times if read is not None]
    by = by or ("time" if len(known) == 2 else "row")
    assumed = [*joints.assumed, *(f"{points.path.name}: {one}" for one in points.assumed)]
    if by == "row":
        if len(joints.rows) != len(points.rows):
            found = f"{counted(len(points.rows), 'row')}"
            expected = f"{len(joints.rows)}, as {joints.path.name} has (or times in both tables)"
            raise BadInput(points.path, "the table", found, expected)
        taken = np.arange(len(points.rows))
        assumed.append(f"row by row with {points.path.name}")
    else:
        for table, (read, _) in zip((joints, points), times, strict=True):
            if read is None:
                expected = "a column of times, or --join row"
                found = f"no such column among {few(table.header)}"
                raise BadInput(table.path, "time_s", found, expected)
        taken, farthest_s = _nearest(joints, points, known, within_s)
        unused = len(joints.rows) - len(np.unique(taken))
        assumed.append(
            f"joined with {points.path.name} by time, at most {farthest_s:.3g} s apart;"
            f" {counted(unused, 'row')} of joints without a point"
        )
    # The points' times only say which joints they belong to, unless there are no others.
    own = set(times[1][1] if known and times[0][0] is not None else ())
    rows = [list(joints.rows[i]) for i in taken.tolist()]
    header = list(joints.header)
    for at, name in enumerate(points.header):
        cells = [row[at] for row in points.rows]
        if at in own or not name:
            continue
        if name in joints.header:
            _require_alike(joints, points, taken, name, cells)
            continue
        header.append(name)
        for row, cell in zip(rows, cells, strict=True):
            row.append(cell)
    return ForeignTable(joints.path, header, rows, assumed)


def _times(table: ForeignTable, arm: Arm) -> tuple[Times | None, list[int]]:
    """When each row was read, if the table says so, and the columns that do."""
    places = find_places(table, arm, {}, number_columns(arm), ())
    at = places.at.get("time_s")
    if at is None:
        return None, []
    unit = word_and_unit(table.header[at])[1]
    check_unit(table, at, unit)
    columns = [at] if places.day is None else [at, places.day]
    return read_times(table, at, unit, places.day, None), columns


def _nearest(
    joints: ForeignTable, points: ForeignTable, times: Sequence[Times], within_s: float
) -> tuple[I64, float]:
    """Return each point's row of joints (m,), and how far apart the farthest two are, s."""
    of_joints, of_points = _on_one_clock(joints, points, times)
    order = np.argsort(of_joints, kind="stable")
    ordered = of_joints[order]
    after = np.clip(np.searchsorted(ordered, of_points), 1, max(len(ordered) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(ordered) - 1)
    nearer = np.abs(ordered[after] - of_points) < np.abs(ordered[before] - of_points)
    nearest = np.where(nearer, after, before)
    apart_s = np.abs(ordered[nearest] - of_points)
    far = np.flatnonzero(~(apart_s <= within_s))
    if len(far):
        i = int(far[0])
        found = f"{counted(len(far), 'point')} without joints near in time, row {i + 1} the first"
        if math.isfinite(apart_s[i]):
            found += f" ({apart_s[i]:.3g} s)"
        expected = f"joints within {within_s:g} s: one clock for both tables, or --join row"
        raise BadInput(points.path, f"row {i + 1}", found, expected)
    return order[nearest], float(apart_s.max(initial=0.0))


def _on_one_clock(
    joints: ForeignTable, points: ForeignTable, times: Sequence[Times]
) -> tuple[F64, F64]:
    """Seconds of both tables since one instant; raises `BadInput` for two clocks."""
    for table, read in zip((joints, points), times, strict=True):
        if read.said == OF_A_DAY:
            expected = "dates with the times, or seconds, of one clock in both tables"
            raise BadInput(table.path, "time_s", "times of a day", expected)
        if not np.isfinite(read.seconds).all():
            row = int(np.flatnonzero(~np.isfinite(read.seconds))[0])
            raise BadInput(table.path, f"row {row + 1}", "no time", "a time in each row")
    one, other = times
    if (one.started is None) != (other.started is None):
        how = ["dates or Unix time" if t.started else "seconds since some instant" for t in times]
        found = f"{how[1]}, and {how[0]} in {joints.path.name}: two clocks"
        raise BadInput(points.path, "time_s", found, "one clock in both tables, or --join row")
    shift_s = 0.0
    if one.started is not None and other.started is not None:
        shift_s = (other.started - one.started).total_seconds()
    of_joints, of_points = np.array(one.seconds), np.array(other.seconds) + shift_s
    if of_points.min() > of_joints.max() or of_points.max() < of_joints.min():
        found = (
            f"{of_points.min():.6g} to {of_points.max():.6g} s, and {of_joints.min():.6g} to"
            f" {of_joints.max():.6g} s in {joints.path.name}: two clocks"
        )
        raise BadInput(points.path, "time_s", found, "one clock in both tables, or --join row")
    return of_joints, of_points


def _require_alike(
    joints: ForeignTable, points: ForeignTable, taken: I64, name: str, cells: Sequence[str]
) -> None:
    """Refuse a column of both tables in which rows that belong together differ."""
    at = joints.header.index(name)
    for i, (row, cell) in enumerate(zip(taken.tolist(), cells, strict=True)):
        theirs = joints.rows[row][at]
        if theirs != cell:
            expected = f"{theirs!r}, as row {row + 1} of {joints.path.name} has it"
            raise BadInput(points.path, f"row {i + 1}, column {name}", repr(cell), expected)

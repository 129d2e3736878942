"""Joins two tables: the joints from the arm's controller, and the points from a tracker."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.data.foreign.places import find_places
from armd.compensation.data.foreign.table import ForeignTable
from armd.compensation.data.foreign.times import OF_A_DAY, Times, check_unit, read_times
from armd.compensation.data.foreign.words import split_unit
from armd.compensation.data.sessions.columns import list_number_columns
from armd.compensation.model.arm import Arm
from armd.errors import BadInput
from armd.terminal.counted import format_count
from armd.terminal.suggest import format_names

JoinBy = Literal["row", "time"]

#: A point is joined with the row of joints nearest in time, if it is no farther than this.
WITHIN_S = 0.5


def join_tables(
    joints: ForeignTable,
    points: ForeignTable,
    arm: Arm,
    by: JoinBy | None,
    within_s: float = WITHIN_S,
) -> ForeignTable:
    """Return one table with a row for each point: its row of joints, and its own columns.

    *by* "row": the tables have equal numbers of rows, in one order. *by* "time": both have times of
    one clock, and a point takes the joints nearest in time, at most *within_s* s away. None: by
    time if both tables have times, else by row. Raises `BadInput`.
    """
    times = [_times(table, arm) for table in (joints, points)]
    readable_times = [read for read, _ in times if read is not None]
    by = by or ("time" if len(readable_times) == 2 else "row")
    assumed = [*joints.assumed, *(f"{points.path.name}: {sentence}" for sentence in points.assumed)]
    if by == "row":
        if len(joints.rows) != len(points.rows):
            actual = f"{format_count(len(points.rows), 'row')}"
            expected = f"{len(joints.rows)}, as {joints.path.name} has (or times in both tables)"
            raise BadInput(points.path, "the table", actual, expected)
        joint_rows = np.arange(len(points.rows))
        assumed.append(f"row by row with {points.path.name}")
    else:
        for table, (read, _) in zip((joints, points), times, strict=True):
            if read is None:
                expected = "a column of times, or --join row"
                actual = f"no such column among {format_names(table.header)}"
                raise BadInput(table.path, "time_s", actual, expected)
        joint_rows, farthest_s = _nearest(joints, points, readable_times, within_s)
        unused = len(joints.rows) - len(np.unique(joint_rows))
        assumed.append(
            f"joined with {points.path.name} by time, at most {farthest_s:.3g} s apart;"
            f" {format_count(unused, 'row')} of joints without a point"
        )
    # If the joints have times, the points' times only serve to join them.
    time_columns = set(times[1][1] if readable_times and times[0][0] is not None else ())
    rows = [list(joints.rows[i]) for i in joint_rows.tolist()]
    header = list(joints.header)
    for column, name in enumerate(points.header):
        cells = [row[column] for row in points.rows]
        if column in time_columns or not name:
            continue
        if name in joints.header:
            _require_alike(joints, points, joint_rows, name, cells)
            continue
        header.append(name)
        for row, cell in zip(rows, cells, strict=True):
            row.append(cell)
    return ForeignTable(joints.path, header, rows, assumed)


def _times(table: ForeignTable, arm: Arm) -> tuple[Times | None, list[int]]:
    """Return the time of each row, if the table has times, and the columns with them."""
    places = find_places(table, arm, {}, list_number_columns(arm), ())
    column = places.column_of.get("time_s")
    if column is None:
        return None, []
    unit = split_unit(table.header[column])[1]
    check_unit(table, column, unit)
    columns = [column] if places.day is None else [column, places.day]
    return read_times(table, column, unit, places.day, None), columns


def _nearest(
    joints: ForeignTable, points: ForeignTable, times: Sequence[Times], within_s: float
) -> tuple[I64, float]:
    """Return each point's row of joints (m,), and the largest distance in time, s."""
    of_joints, of_points = _on_one_clock(joints, points, times)
    order = np.argsort(of_joints, kind="stable")
    ordered = of_joints[order]
    after = np.clip(np.searchsorted(ordered, of_points), 1, max(len(ordered) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(ordered) - 1)
    nearer = np.abs(ordered[after] - of_points) < np.abs(ordered[before] - of_points)
    nearest = np.where(nearer, after, before)
    apart_s = np.abs(ordered[nearest] - of_points)
    distant = np.flatnonzero(~(apart_s <= within_s))
    if len(distant):
        i = int(distant[0])
        actual = (
            f"{format_count(len(distant), 'point')} without joints near in time,"
            f" row {i + 1} the first"
        )
        if math.isfinite(apart_s[i]):
            actual += f" ({apart_s[i]:.3g} s)"
        expected = f"joints within {within_s:g} s: one clock for both tables, or --join row"
        raise BadInput(points.path, f"row {i + 1}", actual, expected)
    return order[nearest], float(apart_s.max(initial=0.0))


def _on_one_clock(
    joints: ForeignTable, points: ForeignTable, times: Sequence[Times]
) -> tuple[F64, F64]:
    """Return the seconds of both tables since one instant; raises `BadInput` for two clocks."""
    for table, read in zip((joints, points), times, strict=True):
        if read.description == OF_A_DAY:
            expected = "dates with the times, or seconds, of one clock in both tables"
            raise BadInput(table.path, "time_s", "times of a day", expected)
        if not np.isfinite(read.seconds).all():
            row = int(np.flatnonzero(~np.isfinite(read.seconds))[0])
            raise BadInput(table.path, f"row {row + 1}", "no time", "a time in each row")
    joint_times, point_times = times
    if (joint_times.started is None) != (point_times.started is None):
        how = ["dates or Unix time" if t.started else "seconds since some instant" for t in times]
        actual = f"{how[1]}, and {how[0]} in {joints.path.name}: two clocks"
        raise BadInput(points.path, "time_s", actual, "one clock in both tables, or --join row")
    shift_s = 0.0
    if joint_times.started is not None and point_times.started is not None:
        shift_s = (point_times.started - joint_times.started).total_seconds()
    of_joints, of_points = np.array(joint_times.seconds), np.array(point_times.seconds) + shift_s
    if of_points.min() > of_joints.max() or of_points.max() < of_joints.min():
        actual = (
            f"{of_points.min():.6g} to {of_points.max():.6g} s, and {of_joints.min():.6g} to"
            f" {of_joints.max():.6g} s in {joints.path.name}: two clocks"
        )
        raise BadInput(points.path, "time_s", actual, "one clock in both tables, or --join row")
    return of_joints, of_points


def _require_alike(
    joints: ForeignTable, points: ForeignTable, joint_rows: I64, name: str, cells: Sequence[str]
) -> None:
    """Raise `BadInput` for a column of both tables that differs between joined rows."""
    column = joints.header.index(name)
    for i, (row, cell) in enumerate(zip(joint_rows.tolist(), cells, strict=True)):
        theirs = joints.rows[row][column]
        if theirs != cell:
            expected = f"{theirs!r}, as row {row + 1} of {joints.path.name} has it"
            raise BadInput(points.path, f"row {i + 1}, column {name}", repr(cell), expected)

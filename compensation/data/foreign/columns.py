"""Converts the columns of a foreign table to those of a session: numbers in its units,
and remarks.
"""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from armd.compensation.data.foreign.places import TEXTS, Places, find_places, refuse_missing_joint
from armd.compensation.data.foreign.table import ForeignTable
from armd.compensation.data.foreign.times import check_unit, read_times
from armd.compensation.data.foreign.words import (
    ANGLES,
    LENGTHS,
    RATES,
    TEMPERATURE,
    TEMPERATURES,
    find_joint_name,
    parse_numbered,
    split_unit,
)
from armd.compensation.data.sessions.columns import QUATERNION, ROLL_PITCH_YAW, list_number_columns
from armd.compensation.model.arm import Arm
from armd.errors import BadInput
from armd.terminal.suggest import format_names

Value = TypeVar("Value")

ALL = "1"
#: An optional column of names, in addition to those that a session needs.
REFLECTOR = "reflector"
#: LeRobot's name of a joint's position: a share of its range, -100 to 100, unless degrees were
#: configured.
LEROBOT_POSITION = ".pos"
#: Names of joints that only LeRobot uses.
LEROBOTS_OWN = ("elbowflex", "wristflex")
MOST_NORMALISED = 100.0
NORMALISED = "normalised"


@dataclass
class FoundColumns:
    """The columns in the form of a session."""

    angle_unit: str  # "rad", "deg", "count", or NORMALISED
    numbers: dict[str, list[float]] = field(default_factory=dict)
    texts: dict[str, list[str]] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    started: datetime.datetime | None = None  # if the table has dates
    joints: dict[str, str] = field(default_factory=dict)  # q1 → its header


@dataclass(frozen=True)
class Given:
    """The user's statements about a table."""

    columns: Mapping[str, str] = field(default_factory=dict)  # a session's → the table's
    angle_unit: str | None = None
    length_unit: str | None = None
    started: datetime.datetime | None = None
    targets: Sequence[str] = ()  # the artefact's, if it is known


def find_columns(table: ForeignTable, arm: Arm, options: Given) -> FoundColumns:
    """Find and convert the columns of a session.

    Raises `BadInput` for a joint without a column, a cell that is not a number, an unknown unit,
    and an ambiguous name.
    """
    names = [*list_number_columns(arm), *TEXTS, REFLECTOR]
    places = find_places(table, arm, options.columns, names, options.targets)
    for k in range(1, arm.n_joints + 1):
        if f"q{k}" not in places.column_of:
            raise refuse_missing_joint(places, k)
    columns = FoundColumns(_angle_unit(table, places.column_of, options.angle_unit))
    for name, column in places.column_of.items():
        header = table.header[column]
        if name in (*TEXTS, REFLECTOR):
            columns.texts[name] = [row[column] for row in table.rows]
            _refuse_empty(table, name, column)
            unit = ""
        elif name == "time_s":
            unit = _take_times(columns, places, column, options.started)
        else:
            values = [table.number(i, column) for i in range(len(table.rows))]
            unit, columns.numbers[name] = _in_unit(table, name, header, values, columns, options)
        if is_angle(name):
            columns.joints[name] = header
        if header != name or unit:
            columns.remarks.append(f"{name} is the column {header!r}{unit}")
    columns.remarks += places.remarks
    _complete(table, columns, options.targets)
    _report_unused(columns, places)
    _check_angles(table, columns, arm)
    return columns


def _take_times(
    columns: FoundColumns, places: Places, column: int, since: datetime.datetime | None
) -> str:
    table = places.table
    unit = split_unit(table.header[column])[1]
    check_unit(table, column, unit)
    times = read_times(table, column, unit, places.day, since)
    columns.numbers["time_s"], columns.started = times.seconds, times.started
    return times.description


def _refuse_empty(table: ForeignTable, name: str, column: int) -> None:
    """Raise `BadInput` for an empty cell: every reading needs its target and placement."""
    for i, row in enumerate(table.rows):
        if not row[column]:
            raise table.fault(i, column, f"the name of a {name}")


def _complete(table: ForeignTable, columns: FoundColumns, targets: Sequence[str]) -> None:
    """Fill in placement, target and times if they have no column; raises `BadInput`."""
    if "target" not in columns.texts and len(targets) > 1:
        expected = f"the column of targets ({format_names(targets)}): --column target=HEADER"
        raise BadInput(
            table.path, "target", f"no such column among {format_names(table.header)}", expected
        )
    n = len(table.rows)
    for name in TEXTS:
        if name not in columns.texts:
            only = targets[0] if name == "target" and targets else ALL
            columns.texts[name] = [only] * n
            columns.remarks.append(f"there is no column for the {name}: all rows have the same")
    if "time_s" not in columns.numbers:
        columns.numbers["time_s"] = [math.nan] * n
        columns.remarks.append("there is no column of times: when each row was read is unknown")


def _report_unused(columns: FoundColumns, places: Places) -> None:
    """Add remarks on columns that are not used, and on sensors without a column."""
    arm = places.arm
    unused = [header for _, header in places.free()]
    if unused:
        columns.remarks.append(f"left out: {', '.join(unused)}")
    warm = [header for header in unused if _is_temperature(header)]
    if warm:
        sensors = f"only {format_names(arm.sensors)}" if arm.sensors else "none"
        columns.remarks.append(
            f"{format_names(warm)}: temperatures without a sensor; the arm.toml has {sensors}"
            " ([[temperature_sensor]], and temperature = of each joint)"
        )
    missing = [name for name in arm.sensors if name not in columns.numbers]
    if missing:
        columns.remarks.append(
            f"no column for the sensor{'s' * (len(missing) > 1)} {format_names(missing)}: missing"
            f" temperatures (--column {missing[0]}=HEADER)"
        )


def _is_temperature(header: str) -> bool:
    word, unit = split_unit(header)
    like = parse_numbered(word)
    return (
        (like is not None and like.kind == "temperature")
        or word in TEMPERATURE[1:]
        or (unit in TEMPERATURES and unit not in ("c", "f", "k"))
    )


def is_angle(name: str) -> bool:
    """Return whether a session's column is a joint's angle."""
    return re.fullmatch(r"q\d+", name) is not None


def _angle_unit(table: ForeignTable, places: Mapping[str, int], option: str | None) -> str:
    if option is not None:
        return option
    columns = [column for name, column in places.items() if is_angle(name)]
    units = {column: split_unit(table.header[column])[1] for column in columns}
    for column, unit in units.items():
        if unit and unit not in ANGLES:
            expected = f"one of {format_names(ANGLES)}, or --angle-unit"
            raise BadInput(
                table.path, f"column {table.header[column]}", f"the unit {unit!r}", expected
            )
    written_units = {ANGLES[unit][0] for unit in units.values() if unit}
    if len(written_units) > 1:
        raise BadInput(
            table.path, "the angles", f"{' and '.join(sorted(written_units))}", "one unit"
        )
    if written_units:
        return written_units.pop()
    values = [abs(table.number(i, column)) for column in columns for i in range(len(table.rows))]
    largest = max(filter(math.isfinite, values), default=0.0)
    lerobot = any(
        table.header[column].lower().endswith(LEROBOT_POSITION)
        or find_joint_name(table.header[column]) in LEROBOTS_OWN
        for column in columns
    )
    if lerobot and largest <= MOST_NORMALISED:
        actual = f"LeRobot's positions, {largest:.4g} at most"
        expected = (
            "--angle-unit deg if it logged degrees (use_degrees), rad if radians, else"
            " --lerobot CALIBRATION.json: -100 to 100 of each joint's sweep"
        )
        raise BadInput(table.path, "the angles", actual, expected)
    if largest > 720:
        raise BadInput(table.path, "the angles", f"{largest:g}", "--angle-unit: deg, or count?")
    unit = "deg" if largest > math.tau else "rad"
    table.assumed.append(f"angles are in {unit}: the largest is {largest:.4g} (--angle-unit)")
    return unit


def _in_unit(
    table: ForeignTable,
    name: str,
    header: str,
    values: list[float],
    columns: FoundColumns,
    options: Given,
) -> tuple[str, list[float]]:
    """Return a text such as `, in inches`, and the values in the unit of a session."""
    unit = split_unit(header)[1]
    factor, shift = 1.0, 0.0
    if name in ("x_mm", "y_mm", "z_mm"):
        unit = options.length_unit or unit or "mm"
        factor = _look_up_unit(table, header, unit, LENGTHS)
    elif re.fullmatch(r"w\d+", name):
        factor = _look_up_unit(table, header, unit or "rad/s", RATES)
    elif is_angle(name):
        if options.angle_unit is None and unit:
            factor = ANGLES[unit][1]
        if factor == 1.0:
            return f", in {columns.angle_unit}", values
    elif name in ROLL_PITCH_YAW:
        angle_unit, factor = _look_up_unit(table, header, unit or "deg", ANGLES)
        if angle_unit == "count":
            raise BadInput(table.path, f"column {header}", "counts", "degrees or radians")
        factor *= math.degrees(1.0) if angle_unit == "rad" else 1.0
    elif not name.startswith("approach") and name not in QUATERNION:
        factor, shift = _look_up_unit(table, header, unit or "c", TEMPERATURES)
    if (factor, shift) == (1.0, 0.0):
        return "", values
    return f", in {unit}", [factor * value + shift for value in values]


def _look_up_unit(table: ForeignTable, header: str, unit: str, units: Mapping[str, Value]) -> Value:
    if unit not in units:
        raise BadInput(
            table.path, f"column {header}", f"the unit {unit!r}", f"one of {format_names(units)}"
        )
    return units[unit]


def _check_angles(table: ForeignTable, columns: FoundColumns, arm: Arm) -> None:
    """Raise `BadInput` for counts of a joint without counts per turn."""
    for k, joint in enumerate(arm.joint, 1):
        if columns.angle_unit == "count" and joint.counts_per_turn is None:
            raise BadInput(table.path, f"q{k}", "counts", "counts_per_turn of it in arm.toml")

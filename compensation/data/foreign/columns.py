"""The columns of a foreign table as a session has them: numbers in its units, and what was said."""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from armd.compensation.data.foreign.places import TEXTS, Places, find_places, without_joint
from armd.compensation.data.foreign.table import ForeignTable
from armd.compensation.data.foreign.times import check_unit, read_times
from armd.compensation.data.foreign.words import (
    ANGLES,
    LENGTHS,
    RATES,
    TEMPERATURE,
    TEMPERATURES,
    joint_name,
    numbered,
    word_and_unit,
)
from armd.compensation.data.session_columns import QUATERNION, ROLL_PITCH_YAW, number_columns
from armd.compensation.model.arm import Arm
from armd.errors import BadInput
from armd.terminal.suggest import few

Value = TypeVar("Value")

ALL = "1"
#: A column of names that a table may have, beside those that a session needs.
REFLECTOR = "reflector"
#: What LeRobot calls a joint's position: a share of its sweep, -100 to 100, unless it was asked
#: for degrees.
LEROBOT_POSITION = ".pos"
#: Joints that LeRobot alone calls so.
LEROBOTS_OWN = ("elbowflex", "wristflex")
MOST_NORMALISED = 100.0
NORMALISED = "normalised"


@dataclass
class FoundColumns:
    """Columns as a session has them."""

    angle_unit: str  # "rad", "deg", "count", or NORMALISED
    numbers: dict[str, list[float]] = field(default_factory=dict)
    texts: dict[str, list[str]] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)
    started: datetime.datetime | None = None  # where the table has dates
    joints: dict[str, str] = field(default_factory=dict)  # q1 → its header


@dataclass(frozen=True)
class Given:
    """What the person says of a table."""

    columns: Mapping[str, str] = field(default_factory=dict)  # a session's → the table's
    angle_unit: str | None = None
    length_unit: str | None = None
    started: datetime.datetime | None = None
    targets: Sequence[str] = ()  # the artefact's, where it is known


def find_columns(table: ForeignTable, arm: Arm, given: Given) -> FoundColumns:
    """Raises `BadInput` for a joint without a column, a cell that is no number, a unit not known,
    and a name that may mean two things."""
    known = [*number_columns(arm), *TEXTS, REFLECTOR]
    places = find_places(table, arm, given.columns, known, given.targets)
    for k in range(1, arm.n_joints + 1):
        if f"q{k}" not in places.at:
            raise without_joint(places, k)
    found = FoundColumns(_angle_unit(table, places.at, given.angle_unit))
    for name, at in places.at.items():
        header = table.header[at]
        if name in (*TEXTS, REFLECTOR):
            found.texts[name] = [row[at] for row in table.rows]
            _refuse_empty(table, name, at)
            unit = ""
        elif name == "time_s":
            unit = _take_times(found, places, at, given.started)
        else:
            values = [table.number(i, at) for i in range(len(table.rows))]
            unit, found.numbers[name] = _in_unit(table, name, header, values, found, given)
        if is_angle(name):
            found.joints[name] = header
        if header != name or unit:
            found.said.append(f"{name} is the column {header!r}{unit}")
    found.said += places.said
    _complete(table, found, given.targets)
    _say_unused(found, places)
    _check_angles(table, found, arm)
    return found


def _take_times(
    found: FoundColumns, places: Places, at: int, since: datetime.datetime | None
) -> str:
    table = places.table
    unit = word_and_unit(table.header[at])[1]
    check_unit(table, at, unit)
    times = read_times(table, at, unit, places.day, since)
    found.numbers["time_s"], found.started = times.seconds, times.started
    return times.said


def _refuse_empty(table: ForeignTable, name: str, at: int) -> None:
    """A reading without a target or placement belongs nowhere."""
    for i, row in enumerate(table.rows):
        if not row[at]:
            raise table.fault(i, at, f"the name of a {name}")


def _complete(table: ForeignTable, found: FoundColumns, targets: Sequence[str]) -> None:
    """Placement and target for all rows where no column has them; raises `BadInput`."""
    if "target" not in found.texts and len(targets) > 1:
        expected = f"the column of targets ({few(targets)}): --column target=HEADER"
        raise BadInput(table.path, "target", f"no such column among {few(table.header)}", expected)
    n = len(table.rows)
    for name in TEXTS:
        if name not in found.texts:
            only = targets[0] if name == "target" and targets else ALL
            found.texts[name] = [only] * n
            found.said.append(f"there is no column for the {name}: all rows have the same")
    if "time_s" not in found.numbers:
        found.numbers["time_s"] = [math.nan] * n
        found.said.append("there is no column of times: when each row was read is unknown")


def _say_unused(found: FoundColumns, places: Places) -> None:
    """Columns that are nothing, and sensors that have none."""
    arm = places.arm
    unused = [header for _, header in places.free()]
    if unused:
        found.said.append(f"left out: {', '.join(unused)}")
    warm = [header for header in unused if _is_temperature(header)]
    if warm:
        sensors = f"only {few(arm.sensors)}" if arm.sensors else "none"
        found.said.append(
            f"{few(warm)}: temperatures without a sensor; the arm.toml has {sensors}"
            " ([[temperature_sensor]], and temperature = of each joint)"
        )
    missing = [name for name in arm.sensors if name not in found.numbers]
    if missing:
        found.said.append(
            f"no column for the sensor{'s' * (len(missing) > 1)} {few(missing)}: missing"
            f" temperatures (--column {missing[0]}=HEADER)"
        )


def _is_temperature(header: str) -> bool:
    word, unit = word_and_unit(header)
    like = numbered(word)
    return (
        (like is not None and like.kind == "temperature")
        or word in TEMPERATURE[1:]
        or (unit in TEMPERATURES and unit not in ("c", "f", "k"))
    )


def is_angle(name: str) -> bool:
    """Whether a session's column is a joint's angle."""
    return re.fullmatch(r"q\d+", name) is not None


def _angle_unit(table: ForeignTable, places: Mapping[str, int], given: str | None) -> str:
    if given is not None:
        return given
    columns = [at for name, at in places.items() if is_angle(name)]
    units = {at: word_and_unit(table.header[at])[1] for at in columns}
    for at, unit in units.items():
        if unit and unit not in ANGLES:
            expected = f"one of {few(ANGLES)}, or --angle-unit"
            raise BadInput(table.path, f"column {table.header[at]}", f"the unit {unit!r}", expected)
    told = {ANGLES[unit][0] for unit in units.values() if unit}
    if len(told) > 1:
        raise BadInput(table.path, "the angles", f"{' and '.join(sorted(told))}", "one unit")
    if told:
        return told.pop()
    values = [abs(table.number(i, at)) for at in columns for i in range(len(table.rows))]
    largest = max(filter(math.isfinite, values), default=0.0)
    lerobot = any(
        table.header[at].lower().endswith(LEROBOT_POSITION)
        or joint_name(table.header[at]) in LEROBOTS_OWN
        for at in columns
    )
    if lerobot and largest <= MOST_NORMALISED:
        found = f"LeRobot's positions, {largest:.4g} at most"
        expected = (
            "--angle-unit deg if it logged degrees (use_degrees), rad if radians, else"
            " --lerobot CALIBRATION.json: -100 to 100 of each joint's sweep"
        )
        raise BadInput(table.path, "the angles", found, expected)
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
    found: FoundColumns,
    given: Given,
) -> tuple[str, list[float]]:
    """`, in inches` or the like, and the values as a session has them."""
    unit = word_and_unit(header)[1]
    factor, shift = 1.0, 0.0
    if name in ("x_mm", "y_mm", "z_mm"):
        unit = given.length_unit or unit or "mm"
        factor = _known(table, header, unit, LENGTHS)
    elif re.fullmatch(r"w\d+", name):
        factor = _known(table, header, unit or "rad/s", RATES)
    elif is_angle(name):
        if given.angle_unit is None and unit:
            factor = ANGLES[unit][1]
        if factor == 1.0:
            return f", in {found.angle_unit}", values
    elif name in ROLL_PITCH_YAW:
        of, factor = _known(table, header, unit or "deg", ANGLES)
        if of == "count":
            raise BadInput(table.path, f"column {header}", "counts", "degrees or radians")
        factor *= math.degrees(1.0) if of == "rad" else 1.0
    elif not name.startswith("approach") and name not in QUATERNION:
        factor, shift = _known(table, header, unit or "c", TEMPERATURES)
    if (factor, shift) == (1.0, 0.0):
        return "", values
    return f", in {unit}", [factor * value + shift for value in values]


def _known(table: ForeignTable, header: str, unit: str, units: Mapping[str, Value]) -> Value:
    if unit not in units:
        raise BadInput(table.path, f"column {header}", f"the unit {unit!r}", f"one of {few(units)}")
    return units[unit]


def _check_angles(table: ForeignTable, found: FoundColumns, arm: Arm) -> None:
    """Counts want counts per turn."""
    for k, joint in enumerate(arm.joint, 1):
        if found.angle_unit == "count" and joint.counts_per_turn is None:
            raise BadInput(table.path, f"q{k}", "counts", "counts_per_turn of it in arm.toml")

"""Which column of a foreign table is what, in which unit: by name, and said."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from armd.compensation.data.foreign_table import ForeignTable
from armd.compensation.data.session_columns import number_columns
from armd.compensation.model.arm import Arm
from armd.errors import BadInput
from armd.terminal.suggest import few, hint

Value = TypeVar("Value")

TEXTS = ("placement", "target")
MISSING = ("", "nan", "na", "n/a", "-", "null", "none")
#: Units as headers have them, in small letters.
ANGLES = {
    **dict.fromkeys(("deg", "°", "degree", "degrees"), "deg"),
    **dict.fromkeys(("rad", "radian", "radians"), "rad"),
    **dict.fromkeys(("count", "counts", "inc"), "count"),
}
LENGTHS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "µm": 1e-3}
LENGTHS |= dict.fromkeys(("in", "inch", "inches", '"'), 25.4)
TIMES = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
#: What a value is multiplied by, and what is added after.
TEMPERATURES = {
    **dict.fromkeys(("c", "°c", "degc"), (1.0, 0.0)),
    **dict.fromkeys(("f", "°f", "degf"), (5 / 9, -160 / 9)),
    "k": (1.0, -273.15),
}
#: The first is a session's own.
RATES = {"rad/s": 1.0, **dict.fromkeys(("deg/s", "°/s"), math.pi / 180)}
_UNITS = {*ANGLES, *LENGTHS, *TIMES, *TEMPERATURES}
_JOINT = re.compile(r"(?:q|j|a|joint|axis|theta|angle|enc|encoder|jointangle|achse|gelenk)_?(\d)")
_RATE = re.compile(r"(?:w|rate|speed|omega|dq|qd)_?(\d)")
_SENSOR = re.compile(r"(?:t|temp|temperature|temperatur)_?(\d+)")
_WORDS = {
    "time": "time_s", "t": "time_s", "zeit": "time_s", "seconds": "time_s",
    "pose": "placement", "setup": "placement", "aufstellung": "placement",
    "ball": "target", "sphere": "target", "point": "target", "seat": "target", "hole": "target",
    "kugel": "target", "punkt": "target", "name": "target",
    "x": "x_mm", "y": "y_mm", "z": "z_mm",
    **dict.fromkeys(
        (f"{thing}{word}" for thing in ("artefact", "artifact", "part")
         for word in ("", "temp", "temperature") if thing + word != "part"), "artefact_c",
    ),
}  # fmt: skip


@dataclass
class FoundColumns:
    """Columns as a session has them."""

    angle_unit: str
    numbers: dict[str, list[float]] = field(default_factory=dict)
    texts: dict[str, list[str]] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)


def find_columns(
    table: ForeignTable,
    arm: Arm,
    given: Mapping[str, str],
    angle_unit: str | None = None,
    length_unit: str | None = None,
) -> FoundColumns:
    """*given*: a session's column → the table's, where the person said so.

    Raises `BadInput` for a joint without a column, a cell that is no number, a unit not known.
    """
    known = [*number_columns(arm), *TEXTS]
    places = _places(table, arm, given, known)
    for k in range(1, arm.n_joints + 1):
        if f"q{k}" not in places:
            expected = f"a column for joint {k}: --column q{k}=HEADER"
            raise BadInput(
                table.path, f"q{k}", f"no such column among {few(table.header)}", expected
            )
    found = FoundColumns(_angle_unit(table, places, angle_unit))
    for name, at in places.items():
        header = table.header[at]
        if name in TEXTS:
            found.texts[name] = [row[at] for row in table.rows]
            unit = ""
        else:
            values = [_number(table, i, at) for i in range(len(table.rows))]
            unit, found.numbers[name] = _in_unit(table, name, header, values, found, length_unit)
        if header != name or unit:
            found.said.append(f"{name} is the column {header!r}{unit}")
    left = [header for i, header in enumerate(table.header) if i not in places.values() and header]
    if left:
        found.said.append(f"left out: {', '.join(left)}")
    warm = [header for header in left if _SENSOR.fullmatch(word_and_unit(header)[0])]
    if warm:
        sensors = f"only {few(arm.sensors)}" if arm.sensors else "none"
        found.said.append(
            f"{few(warm)}: temperatures without a sensor; the arm.toml has {sensors}"
            " ([[temperature_sensor]], and temperature = of each joint)"
        )
    _check_angles(table, found, arm)
    return found


def _places(
    table: ForeignTable, arm: Arm, given: Mapping[str, str], known: Sequence[str]
) -> dict[str, int]:
    """A session's column → its number in the table."""
    places: dict[str, int] = {}
    for name, header in given.items():
        if name not in known:
            raise BadInput("the command line", "--column", name, f"a column{hint(name, known)}")
        if header not in table.header:
            expected = f"a column of the table{hint(header, table.header)}"
            raise BadInput(table.path, "--column", repr(header), expected)
        places[name] = table.header.index(header)
    for at, header in enumerate(table.header):
        meant = _meant(header, arm, known)
        if at in places.values() or meant is None or meant in given:
            continue
        if meant in places:
            both = f"{table.header[places[meant]]!r} and {header!r}"
            raise BadInput(table.path, meant, f"two columns, {both}", f"--column {meant}=HEADER")
        places[meant] = at
    return {name: places[name] for name in known if name in places}


def _meant(header: str, arm: Arm, known: Sequence[str]) -> str | None:
    """The session's name of a column called *header*."""
    if header in known:
        return header
    word, _ = word_and_unit(header)
    by_word = {word_and_unit(name)[0]: name for name in (*arm.sensors, *TEXTS, "artefact_c")}
    if word in by_word:
        return by_word[word]
    if (joint := _JOINT.fullmatch(word)) and int(joint[1]) <= arm.n_joints:
        return f"q{joint[1]}"
    if (rate := _RATE.fullmatch(word)) and int(rate[1]) <= arm.n_joints:
        return f"w{rate[1]}"
    if (sensor := _SENSOR.fullmatch(word)) and 1 <= int(sensor[1]) <= len(arm.sensors):
        return arm.sensors[int(sensor[1]) - 1]
    return _WORDS.get(word)


def word_and_unit(header: str) -> tuple[str, str]:
    """`Joint 1 [deg]`, `q1_deg`, `X (in)` as a bare word and a unit, both in small letters."""
    text = header.lower().strip()
    if bracketed := re.fullmatch(r"(.*?)[\[(/]\s*([^\])]*?)\s*[\])]?", text):
        text, unit = bracketed[1], bracketed[2]
    else:
        *words, last = re.split(r"[ _]+", text)
        text, unit = ("".join(words), last) if words and last in _UNITS else (text, "")
    return re.sub(r"[^a-zäöü0-9]", "", text), unit


def _angle_unit(table: ForeignTable, places: Mapping[str, int], given: str | None) -> str:
    if given is not None:
        return given
    units = {word_and_unit(table.header[at])[1] for name, at in places.items() if name[0] == "q"}
    told = {ANGLES[unit] for unit in units if unit in ANGLES}
    if len(told) > 1:
        raise BadInput(table.path, "the angles", f"{' and '.join(sorted(told))}", "one unit")
    if told:
        return told.pop()
    largest = max(
        abs(_number(table, i, at)) for name, at in places.items() if name[0] == "q"
        for i in range(len(table.rows))
    )  # fmt: skip
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
    length_unit: str | None,
) -> tuple[str, list[float]]:
    """`, in inches` or the like, and the values as a session has them."""
    unit = word_and_unit(header)[1]
    factor, shift = 1.0, 0.0
    if name in ("x_mm", "y_mm", "z_mm"):
        unit = length_unit or unit or "mm"
        factor = _known(table, header, unit, LENGTHS)
    elif name == "time_s":
        factor = _known(table, header, unit or "s", TIMES)
    elif name[0] == "w" and name[1:].isdigit():
        factor = _known(table, header, unit or "rad/s", RATES)
    elif name[0] == "q" and name[1:].isdigit():
        return f", in {found.angle_unit}", values
    elif not name.startswith("approach"):
        factor, shift = _known(table, header, unit or "c", TEMPERATURES)
    if (factor, shift) == (1.0, 0.0):
        return "", values
    return f", in {unit}", [factor * value + shift for value in values]


def _known(table: ForeignTable, header: str, unit: str, units: Mapping[str, Value]) -> Value:
    if unit not in units:
        raise BadInput(table.path, f"column {header}", f"the unit {unit!r}", f"one of {few(units)}")
    return units[unit]


def _number(table: ForeignTable, row: int, column: int) -> float:
    text = table.rows[row][column]
    if text.lower() in MISSING:
        return math.nan
    try:
        return float(text)
    except ValueError as error:
        where = f"row {row + 1}, column {table.header[column]}"
        raise BadInput(table.path, where, repr(text), "a number") from error


def _check_angles(table: ForeignTable, found: FoundColumns, arm: Arm) -> None:
    """Counts want counts per turn."""
    for k, joint in enumerate(arm.joint, 1):
        if found.angle_unit == "count" and joint.counts_per_turn is None:
            raise BadInput(table.path, f"q{k}", "counts", "counts_per_turn of it in arm.toml")

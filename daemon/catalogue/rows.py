"""A table with a row per joint, as a drawing or a spreadsheet has it, as an arm.toml."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from armd.compensation.data.foreign_columns import ANGLES, LENGTHS, word_and_unit
from armd.compensation.data.foreign_table import ForeignTable, read_table
from armd.errors import BadInput
from armd.files.toml_text import toml_text
from armd.terminal.suggest import few, hint

#: Keys of a joint that a table may have.
ROW = (
    "theta_deg", "d_mm", "a_mm", "alpha_deg", "beta_deg", "min_deg", "max_deg", "counts_per_turn",
    "temperature",
)  # fmt: skip
LENGTH_KEYS = ("d_mm", "a_mm")
#: What a column that only counts the joints is called.
NUMBERS = ("", "joint", "axis", "link", "no", "nr", "i", "j", "k", "row", "gelenk", "achse")
GREEK = str.maketrans({"θ": "theta", "ϑ": "theta", "α": "alpha", "β": "beta"})
#: A length of an arm, all links together, that is a slip of the unit: the smallest arm that armd
#: knows has 0.4 m; the largest, in m, has 4.
SHORTEST_MM = 20.0
#: Angles of a drawing in rad, which in degrees nobody would write with decimals.
RIGHT_ANGLES_RAD = (math.pi / 2, math.pi)
IN_DEGREES = {"deg": 1.0, "rad": 180.0 / math.pi}


def from_rows(path: Path) -> tuple[str, list[str]]:
    """The text of arm.toml, and what was assumed; raises `BadInput`."""
    table = read_table(path)
    columns, said = _columns(table)
    if not any(name in columns for name in LENGTH_KEYS):
        expected = "a column d_mm or a_mm: an arm without lengths reaches nowhere"
        raise BadInput(path, "the header", few(table.header), expected)
    if "alpha_deg" not in columns:
        expected = "a column alpha_deg too, with 0 where an axis is parallel to the one before"
        raise BadInput(path, "the header", few(table.header), expected)
    for name in ("theta_deg", "d_mm", "a_mm"):
        if name not in columns:
            said.append(f"{name}: there is no such column, it is 0 in each joint")
    joints = [
        {
            name: _value(table, number, at, name, factor)
            for name, (at, factor) in columns.items()
            if row[at]
        }
        for number, row in enumerate(table.rows)
    ]
    for name in ("theta_deg", "d_mm", "a_mm", "alpha_deg"):
        empty = [
            str(k) for k, joint in enumerate(joints, 1) if name in columns and name not in joint
        ]
        if empty:
            said.append(f"{name}: empty for joint {', '.join(empty)}, which makes it 0")
    said.append(_size_of(table, columns, joints))
    sensors = dict.fromkeys(str(joint["temperature"]) for joint in joints if "temperature" in joint)
    content = {
        "schema": "armd.arm/1",
        "serial_number": "ARM-1",
        "temperature_sensor": [{"name": name} for name in sensors],
        "joint": joints,
        "tip": {"offset_mm": [0.0, 0.0, 0.0], "radius_mm": 0.0},
    }
    if not sensors:
        del content["temperature_sensor"]
    return toml_text(content), said


def _columns(table: ForeignTable) -> tuple[dict[str, tuple[int, float]], list[str]]:
    """A joint's key → where it stands in the table, and what a number of it is multiplied by."""
    found: dict[str, tuple[int, float]] = {}
    said = list(table.assumed)
    by_word = {word_and_unit(name)[0]: name for name in ROW[:-2]} | {
        name.replace("_", ""): name for name in ROW[-2:]
    }
    for at, header in enumerate(table.header):
        word, unit = word_and_unit(header.translate(GREEK))
        if header in ROW:
            name = header
        elif word in NUMBERS:
            continue
        elif (told := by_word.get(word)) is None:
            raise BadInput(
                table.path, "the header", repr(header), f"a key of a joint{hint(header, ROW)}"
            )
        else:
            name = told
            taken = "" if unit else _taken(name)
            said.append(f"{name} is the column {header!r}{taken}")
        if name in found:
            both = f"{table.header[found[name][0]]!r} and {header!r}"
            raise BadInput(table.path, name, f"two columns, {both}", "one")
        found[name] = (at, _factor(table, header, name, unit))
    return {name: found[name] for name in ROW if name in found}, said


def _taken(name: str) -> str:
    """The unit of a column whose header says none."""
    unit = {"mm": "mm", "deg": "degrees"}.get(name.rpartition("_")[2])
    return f", in {unit}: its header says no unit" if unit else ""


def _size_of(
    table: ForeignTable,
    columns: Mapping[str, tuple[int, float]],
    joints: Sequence[Mapping[str, str | float]],
) -> str:
    """How long the arm is; raises `BadInput` where its units cannot be armd's."""
    for name in ("theta_deg", "alpha_deg"):
        values = [abs(float(joint.get(name, 0.0))) for joint in joints]
        in_rad = any(abs(v - right) < 0.01 for v in values for right in RIGHT_ANGLES_RAD)
        if in_rad and max(values) < 2.0 * math.pi:
            at, _ = columns[name]
            found = f"angles of {max(values):g} degrees at most"
            expected = "degrees, or a header with another unit, as 'alpha (rad)'"
            raise BadInput(table.path, f"column {table.header[at]}", found, expected)
    total_mm = sum(abs(float(joint.get(name, 0.0))) for joint in joints for name in LENGTH_KEYS)
    if total_mm < SHORTEST_MM:
        found = f"{total_mm:g} mm, all of d and a together"
        expected = "mm, or a header with another unit, as 'd (m)' or 'd (in)'"
        raise BadInput(table.path, "the lengths", found, expected)
    return f"the lengths d and a add up to {total_mm:.6g} mm"


def _factor(table: ForeignTable, header: str, name: str, unit: str) -> float:
    """From the column's unit to armd's."""
    units: Mapping[str, float] = {}
    if name.endswith("_mm"):
        units = LENGTHS
    elif name.endswith("_deg"):
        units = {word: IN_DEGREES[meant] for word, meant in ANGLES.items() if meant in IN_DEGREES}
    if not units or not unit:
        return 1.0
    if unit not in units:
        expected = f"one of {few(units)}"
        raise BadInput(table.path, f"column {header}", f"the unit {unit!r}", expected)
    return units[unit]


def _value(table: ForeignTable, row: int, at: int, name: str, factor: float) -> str | float:
    cell = table.rows[row][at]
    if name == "temperature":
        return cell
    try:
        value = float(cell)
    except ValueError as error:
        where = f"row {row + 1}, column {table.header[at]}"
        raise BadInput(table.path, where, repr(cell), "a number") from error
    if name == "counts_per_turn":
        return int(value)
    return round(factor * value, 9)  # 17.5 in are 444.5 mm, and no digits of 2⁻⁵³ after

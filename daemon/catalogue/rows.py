"""Convert a table with a row per joint (a drawing, a spreadsheet) to an arm.toml.

Its convention is the standard one, A = Rz(θ)·Tz(d)·Tx(a)·Rx(α), or the modified one (Craig 1986),
Rx(α)·Tx(a)·Rz(θ)·Tz(d), whose row has α and a of the link before.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armd.compensation.data.foreign.cells import parse_number
from armd.compensation.data.foreign.table import ForeignTable, read_table
from armd.compensation.data.foreign.words import (
    ANGLES,
    LENGTHS,
    NUMBERS,
    OF_A_JOINT,
    split_unit,
)
from armd.daemon.catalogue.chain_rows import DH, ChainRows, convert_to_hayati, to_standard_rows
from armd.errors import BadInput
from armd.files.toml_text import format_toml
from armd.terminal.suggest import format_names, suggest_names

#: Keys of a joint that a table may have.
ROW = tuple(OF_A_JOINT)
LENGTH_KEYS = ("d_mm", "a_mm")
#: Convention → the transformation of a row.
CONVENTIONS = {
    "standard": "Rz(theta) Tz(d) Tx(a) Rx(alpha)",
    "modified": "Rx(alpha) Tx(a) Rz(theta) Tz(d), alpha and a of the link before (Craig)",
}
#: Columns in Craig's order; a table in the standard convention may have this order too.
CRAIGS_ORDER = ["alpha_deg", "a_mm", "d_mm", "theta_deg"]
#: A header's index: a_{i-1}, alpha i-1.
_PREVIOUS = re.compile(r"[ _]*[({\[]?\s*[ijkn]\s*[-−–]\s*1\s*[)}\]]?")
_INDEX = re.compile(r"(?<=[a-zA-Zθαβ])_\{?[ijkn]\}?(?=$|[ (\[])")
#: A last row with such a name is not a joint.
_AFTER_THE_LAST = re.compile(r"flange|flansch|tcp|tool|werkzeug|ee|end.?effector|hand|tip", re.I)
#: A joint's variable as a drawing writes it, with its offset: q2, θ_2 - 90°.
_VARIABLE = re.compile(r"(?:q|θ|theta)_?\d*\*?\s*([+-]\s*[\d.]+)?\s*°?", re.I)
#: An arm whose links together are shorter has a wrong unit: the smallest arm that armd knows has
#: 0.4 m, which are 400 mm; the largest, with its metres taken as mm, has 4.
SHORTEST_MM = 20.0
#: Right angles of a drawing in rad; nobody writes such decimals in degrees.
RIGHT_ANGLES_RAD = (math.pi / 2, math.pi)
IN_DEGREES = {"deg": 1.0, "rad": 180.0 / math.pi}
#: No length, angle or encoder of an arm has a larger number, in any unit.
LARGEST = 1e12


@dataclass(frozen=True)
class Columns:
    """The column of each key of a joint, and the factor of its numbers."""

    by_key: dict[str, tuple[int, float]]
    remarks: list[str]
    previous: bool  # whether a header's index is i-1
    names: int | None  # the column that names or counts the joints


def from_rows(path: Path, convention: str | None = None) -> tuple[str, list[str]]:
    """Return the text of arm.toml and the assumptions made; raises `BadInput`.

    *convention* is "standard" or "modified"; without it the headers decide, else it is the standard
    one.
    """
    table = read_table(path)
    columns = _find_columns(table)
    remarks = columns.remarks
    if not any(name in columns.by_key for name in LENGTH_KEYS):
        expected = "a column d_mm or a_mm: an arm without lengths reaches nowhere"
        raise BadInput(path, "the header", format_names(table.header), expected)
    if "alpha_deg" not in columns.by_key:
        expected = "a column alpha_deg too, with 0 where an axis is parallel to the one before"
        raise BadInput(path, "the header", format_names(table.header), expected)
    convention = convention or _find_convention(table, columns)
    for name in ("theta_deg", "d_mm", "a_mm"):
        if name not in columns.by_key:
            remarks.append(f"{name}: there is no such column, it is 0 in each joint")
    joints = [_make_joint(table, row, columns) for row in range(len(table.rows))]
    after = _find_after_last(table, columns, joints, remarks)
    for name in DH[:4]:
        empty = [
            str(k)
            for k, joint in enumerate(joints, 1)
            if name in columns.by_key and name not in joint
        ]
        if empty:
            remarks.append(f"{name}: empty for joint {', '.join(empty)}, which makes it 0")
    remarks.append(_read_size(table, columns.by_key, joints))
    remarks.append(f"rows are read in the {convention} convention, {CONVENTIONS[convention]}")
    rows = ChainRows(joints, after)
    if convention == "modified":
        rows = to_standard_rows(rows, remarks)
    rows = convert_to_hayati(rows, remarks)
    return _write_text(rows, remarks), remarks


def _write_text(rows: ChainRows, remarks: list[str]) -> str:
    """Return the arm.toml; add to *remarks* the tip at zero angles, for a person to check."""
    remarks.append(f"the tip at zero angles: {rows.tip_text()}")
    sensors = dict.fromkeys(str(j["temperature"]) for j in rows.joints if "temperature" in j)
    content: dict[str, Any] = {
        "schema": "armd.arm/1",
        "serial_number": "ARM-1",
        "gravity": rows.gravity(),
        "temperature_sensor": [{"name": name} for name in sensors],
        "joint": rows.joints,
        "tip": {"offset_mm": rows.tip_offset(), "radius_mm": 0.0},
    }
    if not sensors:
        del content["temperature_sensor"]
    if content["gravity"] == [0.0, 0.0, -1.0]:
        del content["gravity"]
    return format_toml(content)


def _find_convention(table: ForeignTable, columns: Columns) -> str:
    """Return the convention that the headers show.

    Raises `BadInput` where the columns are in Craig's order and no index confirms it.
    """
    if columns.previous:
        columns.remarks.append("alpha and a have the index i-1: the table is of the modified form")
        return "modified"
    order = sorted(
        (name for name in columns.by_key if name in CRAIGS_ORDER), key=columns.by_key.__getitem__
    )
    if order == CRAIGS_ORDER:
        problem = "columns in the order of modified rows (alpha, a, d, theta)"
        expected = (
            "--modified, if alpha and a are of the link before (Craig, as Franka has them),"
            " or --standard"
        )
        raise BadInput(table.path, "the header", problem, expected)
    return "standard"


def _make_joint(table: ForeignTable, row: int, columns: Columns) -> dict[str, Any]:
    return {
        name: _read_value(table, row, column, name, factor)
        for name, (column, factor) in columns.by_key.items()
        if table.rows[row][column]
    }


def _find_after_last(
    table: ForeignTable, columns: Columns, joints: list[dict[str, Any]], remarks: list[str]
) -> dict[str, Any] | None:
    """Remove the last row from *joints* and return it, if its name is not a joint's."""
    if columns.names is None or not _AFTER_THE_LAST.fullmatch(table.rows[-1][columns.names]):
        return None
    remarks.append(f"the row {table.rows[-1][columns.names]!r} is no joint: it places the tip")
    return joints.pop()


def _find_columns(table: ForeignTable) -> Columns:
    columns: dict[str, tuple[int, float]] = {}
    remarks = list(table.assumed)
    previous, names = False, None
    by_word = {split_unit(name)[0]: name for name in ROW[:-2]}
    by_word |= {word: name for name, words in OF_A_JOINT.items() for word in words}
    for index, header in enumerate(table.header):
        without_index = _INDEX.sub("", _PREVIOUS.sub("", header))
        word, unit = split_unit(without_index)
        if header in ROW:
            name = header
        elif word in NUMBERS:
            names = index if names is None else names
            continue
        elif (key := by_word.get(word)) is None:
            raise BadInput(
                table.path,
                "the header",
                repr(header),
                f"a key of a joint{suggest_names(header, ROW)}",
            )
        else:
            name = key
            assumption = "" if unit else _describe_assumed_unit(name)
            remarks.append(f"{name} is the column {header!r}{assumption}")
            if name in ("alpha_deg", "a_mm"):
                previous = previous or _PREVIOUS.search(header) is not None
        if name in columns:
            headers = f"{table.header[columns[name][0]]!r} and {header!r}"
            raise BadInput(table.path, name, f"two columns, {headers}", "one")
        columns[name] = (index, _get_factor(table, header, name, unit))
    in_order = {name: columns[name] for name in ROW if name in columns}
    return Columns(in_order, remarks, previous, names)


def _describe_assumed_unit(name: str) -> str:
    """Describe the assumed unit of a column whose header has none."""
    unit = {"mm": "mm", "deg": "degrees"}.get(name.rpartition("_")[2])
    return f", in {unit}: its header says no unit" if unit else ""


def _read_size(
    table: ForeignTable,
    columns: Mapping[str, tuple[int, float]],
    joints: Sequence[Mapping[str, Any]],
) -> str:
    """Describe the arm's total length; raises `BadInput` where its units cannot be armd's."""
    for name in ("theta_deg", "alpha_deg"):
        values = [abs(float(joint.get(name, 0.0))) for joint in joints]
        in_rad = any(abs(v - right) < 0.01 for v in values for right in RIGHT_ANGLES_RAD)
        if in_rad and max(values) < 2.0 * math.pi:
            column, _ = columns[name]
            problem = f"angles of {max(values):g} degrees at most"
            expected = "degrees, or a header with another unit, as 'alpha (rad)'"
            raise BadInput(table.path, f"column {table.header[column]}", problem, expected)
    total_mm = sum(abs(float(joint.get(name, 0.0))) for joint in joints for name in LENGTH_KEYS)
    if total_mm < SHORTEST_MM:
        problem = f"{total_mm:g} mm, all of d and a together"
        expected = "mm, or a header with another unit, as 'd (m)' or 'd (in)'"
        raise BadInput(table.path, "the lengths", problem, expected)
    return f"the lengths d and a add up to {total_mm:.6g} mm"


def _get_factor(table: ForeignTable, header: str, name: str, unit: str) -> float:
    """Return the factor from the column's unit to armd's."""
    units: Mapping[str, float] = {}
    if name.endswith("_mm"):
        units = LENGTHS
    elif name.endswith("_deg"):
        units = {
            word: factor * IN_DEGREES[angle_unit]
            for word, (angle_unit, factor) in ANGLES.items()
            if angle_unit in IN_DEGREES
        }
    if not units or not unit:
        return 1.0
    if unit not in units:
        expected = f"one of {format_names(units)}"
        raise BadInput(table.path, f"column {header}", f"the unit {unit!r}", expected)
    return units[unit]


def _read_value(
    table: ForeignTable, row: int, column: int, name: str, factor: float
) -> str | float:
    cell = table.rows[row][column]
    if name == "temperature":
        return cell
    value = parse_number(cell)
    if name == "theta_deg" and (variable := _VARIABLE.fullmatch(cell)):
        value = float((variable[1] or "0").replace(" ", ""))
    if value is None:
        raise table.fault(row, column, "a number, in numerals")
    if not math.isfinite(value):
        return 0.0
    if abs(value) > LARGEST:
        raise table.fault(row, column, f"a number of {LARGEST:g} at most")
    if name == "counts_per_turn":
        return int(value)
    return float(np.round(factor * value, 9))  # 17.5 in are 444.5 mm, without rounding errors

"""Read an artefact's certificate as a table: a row per target, or per length between two."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from armd.compensation.data.foreign.table import ForeignTable, read_table
from armd.compensation.data.foreign.words import LENGTHS, WORDS, split_unit
from armd.compensation.data.sessions.format import Artefact
from armd.errors import BadInput
from armd.files.schema import validate
from armd.terminal.suggest import format_names

#: Column of uncertainty → factor to a standard uncertainty: certificates state U with k = 2.
UNCERTAINTY = {
    **dict.fromkeys(("u", "standarduncertainty", "standarduncertaintymm", "uc", "sigma"), 1.0),
    **dict.fromkeys(("expandeduncertainty", "uk2", "u95", "uncertaintyk2"), 0.5),
}
AXES = ("x", "y", "z")
LENGTH = ("length", "distance", "laenge", "länge", "abstand", "lengthmm", "distancemm")
FROM = ("from", "a", "first", "von", "sphere1", "ball1", "target1", "point1", "between")
TO = ("to", "b", "second", "bis", "sphere2", "ball2", "target2", "point2", "and")


def read_artefact_table(path: Path) -> tuple[Artefact, list[str]]:
    """Return the artefact of a certificate's table, and the assumptions as sentences.

    Columns: a name and x, y, z, or two names and a length; optionally an uncertainty. Raises
    `BadInput`.
    """
    table = read_table(path)
    remarks = list(table.assumed)
    content: dict[str, Any] = {"name": path.stem}
    columns: dict[str, int] = {}
    for column, header in enumerate(table.header):
        word = split_unit(header)[0]
        for name, words in (("length", LENGTH), ("from", FROM), ("to", TO)):
            if word in words:
                columns.setdefault(name, column)
        if word in AXES:
            columns.setdefault(word, column)
        elif WORDS.get(word) == "target" and word not in (*FROM, *TO):
            columns.setdefault("name", column)
        elif _find_uncertainty_factor(header) is not None:
            columns.setdefault("uncertainty", column)
    if columns.keys() >= {"name", *AXES}:
        content["target"] = [_read_target(table, i, columns) for i in range(len(table.rows))]
    elif columns.keys() >= {"from", "to", "length"}:
        content["distance"] = [_read_distance(table, i, columns) for i in range(len(table.rows))]
    else:
        expected = "columns name, x, y, z, or from, to, length"
        raise BadInput(path, "the header", format_names(table.header), expected)
    for name, column in columns.items():
        remarks.append(f"{name} of the artefact is the column {table.header[column]!r}")
    if "uncertainty" in columns:
        share = _find_uncertainty_factor(table.header[columns["uncertainty"]])
        how = "standard uncertainties" if share == 1.0 else "expanded uncertainties, halved (k = 2)"
        remarks.append(f"the certificate's uncertainties are read as {how}")
    unused = [h for column, h in enumerate(table.header) if h and column not in columns.values()]
    if unused:
        remarks.append(f"left out of the artefact: {', '.join(unused)}")
    remarks.append("the artefact's expansion is taken as 0: expansion_per_k in session.toml")
    return validate(path, content, Artefact), remarks


def _find_uncertainty_factor(header: str) -> float | None:
    """Return the factor from a column to a standard uncertainty, None for another column."""
    word, _ = split_unit(header)
    if word == "u":  # a capital U is an expanded uncertainty (GUM 6.2)
        return 0.5 if header.strip()[:1] == "U" else 1.0
    return UNCERTAINTY.get(word)


def _read_mm(table: ForeignTable, row: int, column: int) -> float:
    unit = split_unit(table.header[column])[1] or "mm"
    if unit not in LENGTHS:
        location = f"column {table.header[column]}"
        raise BadInput(
            table.path, location, f"the unit {unit!r}", f"one of {format_names(LENGTHS)}"
        )
    value = LENGTHS[unit] * table.number(row, column)
    if not math.isfinite(value):
        raise table.fault(row, column, "a number")
    return round(value, 12)


def _read_name(table: ForeignTable, row: int, column: int) -> str:
    name = table.rows[row][column]
    if not name:
        raise table.fault(row, column, "the name of a target")
    return name


def _with_uncertainty(
    table: ForeignTable, row: int, columns: dict[str, int], content: dict[str, Any]
) -> dict[str, Any]:
    column = columns.get("uncertainty")
    if column is None or not table.rows[row][column]:
        return content
    share = _find_uncertainty_factor(table.header[column]) or 1.0
    return content | {"standard_uncertainty_mm": share * _read_mm(table, row, column)}


def _read_target(table: ForeignTable, row: int, columns: dict[str, int]) -> dict[str, Any]:
    cells = [table.rows[row][columns[axis]] for axis in AXES]
    target: dict[str, Any] = {"name": _read_name(table, row, columns["name"])}
    if not any(cells):
        return target  # an unknown fixed point
    target["position_mm"] = [_read_mm(table, row, columns[axis]) for axis in AXES]
    return _with_uncertainty(table, row, columns, target)


def _read_distance(table: ForeignTable, row: int, columns: dict[str, int]) -> dict[str, Any]:
    between = [_read_name(table, row, columns[end]) for end in ("from", "to")]
    length = {"between": between, "length_mm": _read_mm(table, row, columns["length"])}
    return _with_uncertainty(table, row, columns, length)

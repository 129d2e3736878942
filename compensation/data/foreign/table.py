"""Reads a table of readings of another program; the form is detected and reported.

CSV of any separator, with a decimal comma or point, in any usual encoding; Excel's .xlsx.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

from armd.compensation.data.foreign.cells import (
    Cells,
    has_mostly_numbers,
    is_number,
    parse_number,
)
from armd.compensation.data.foreign.text import read_text
from armd.compensation.data.foreign.words import UNITLESS, UNITS, split_unit
from armd.compensation.data.foreign.workbook import EXCEL, read_workbook
from armd.errors import BadInput
from armd.terminal.suggest import format_names

#: Suffixes of files that are read as tables.
TABLES = (".csv", ".tsv", ".txt", ".xlsx")


@dataclass
class ForeignTable:
    """A table with cells as text; numbers have a decimal point."""

    path: Path
    header: list[str]
    rows: list[list[str]]
    assumed: list[str] = field(default_factory=list)
    """How it was read: a sentence each."""

    def number(self, row: int, column: int) -> float:
        """Return a cell's number, NaN if it is missing; raises `BadInput`."""
        value = parse_number(self.rows[row][column])
        if value is None:
            raise self.fault(row, column, "a number")
        return value

    def of_prefix(self, prefix: str) -> ForeignTable:
        """Return the table without other arms' joints, and without *prefix* in the names of this
        arm's.

        Columns that belong to no arm are kept. A column belongs to another arm if its name ends
        like one of this arm's, after another prefix. Raises `BadInput` if no column has the prefix.
        """
        prefix = f"{prefix.rstrip('_')}_"
        arm_columns = {name.removeprefix(prefix) for name in self.header if name.startswith(prefix)}
        if not arm_columns:
            raise BadInput(
                self.path, "--prefix", repr(prefix), f"one of {format_names(self.header)}"
            )
        columns, header = [], []
        for column, name in enumerate(self.header):
            bare = name.removeprefix(prefix)
            if name.startswith(prefix) or not any(
                name.endswith(f"_{suffix}") for suffix in arm_columns
            ):
                columns.append(column)
                header.append(bare)
        rows = [[row[column] for column in columns] for row in self.rows]
        return ForeignTable(self.path, header, rows, self.assumed)

    def fault(self, row: int, column: int, expected: str) -> BadInput:
        """Return an error about one cell."""
        location = f"row {row + 1}, column {self.header[column]}"
        return BadInput(self.path, location, repr(self.rows[row][column]), expected)


def read_table(path: Path, sheet: str | None = None) -> ForeignTable:
    """Read a table; raises `BadInput` for anything that is not a table with a header."""
    if path.suffix.lower() in EXCEL:
        cells, assumed = read_workbook(path, sheet)
    elif path.suffix.lower() == ".xls":
        raise BadInput(path, "the file", "Excel's format of before 2007", "it saved as .xlsx")
    elif sheet is not None:
        raise BadInput(path, "--sheet", repr(sheet), "a workbook (.xlsx), which has sheets")
    else:
        cells, assumed = read_text(path)
    begin = _header(cells)
    if begin is not None and has_mostly_numbers(cells[begin]):
        raise _without_header(path, begin, cells[begin])
    if begin is None or begin + 1 == len(cells):
        raise BadInput(path, "the table", "no rows", "a header and one row per reading")
    header = [cell.strip() for cell in cells[begin]]
    while header and not header[-1]:
        header.pop()
    if begin:
        assumed.append(f"line {begin + 1} is the header; lines above it are skipped")
    header, first = _with_units(path, header, cells, begin + 1, assumed)
    rows = []
    for line, row in enumerate(cells[first:], first + 1):
        if not any(row):
            continue
        if any(row[len(header) :]):
            raise BadInput(path, f"line {line}", f"{len(row)} columns", f"{len(header)}")
        rows.append([*row, *[""] * (len(header) - len(row))][: len(header)])
    if not rows:
        raise BadInput(path, "the table", "no rows", "a header and one row per reading")
    return ForeignTable(path, header, rows, assumed)


def has_file(folder: Path, name: str | Path) -> bool:
    """Return whether *folder* is a folder with this file; False for a name that is too long."""
    with suppress(OSError):
        return (folder / name).is_file()
    return False


def _without_header(path: Path, begin: int, row: Sequence[str]) -> BadInput:
    names = ",".join(f"q{k}" for k in range(1, len(row) + 1))
    expected = f"a header: write a first line with the columns' names, as {names}"
    return BadInput(path, f"line {begin + 1}", "numbers and no header", expected)


def _header(cells: Cells) -> int | None:
    """Return the line of the header, counted from 0, or None.

    It is the line with most cells above the first line of numbers, because a program may write its
    name or a date above it. Without a line of numbers it is the first line with several cells.
    """
    lines = {i: row for i, row in enumerate(cells) if sum(map(bool, row)) > 1}
    numbers = next((i for i, row in lines.items() if sum(map(is_number, row)) > 1), None)
    above = {i: row for i, row in lines.items() if numbers is not None and i < numbers}
    return max(above, key=lambda i: sum(map(bool, above[i])), default=next(iter(lines), None))


def _with_units(
    path: Path, header: list[str], cells: Cells, first: int, assumed: list[str]
) -> tuple[list[str], int]:
    """Return the header with the units of the line below it, if there are any, and the first row.

    Raises `BadInput` for a line there that is neither units nor a reading.
    """
    filled = [i for i in range(first, len(cells)) if any(cells[i])]
    if len(filled) < 2:
        return header, first
    row, below = cells[filled[0]], cells[filled[1]]
    units = [cell.strip("[]() ").lower() for cell in row]
    are_units = [unit in UNITS for unit in units]
    are_unitless = [not unit or unit in UNITLESS for unit in units]
    if any(are_units) and all(k or p for k, p in zip(are_units, are_unitless, strict=True)):
        assumed.append(f"line {filled[0] + 1} has the columns' units")
        units += [""] * (len(header) - len(units))
        header = [
            f"{name} [{unit}]" if unit in UNITS and not split_unit(name)[1] else name
            for name, unit in zip(header, units, strict=False)
        ]
        return header, filled[0] + 1
    if not any(map(is_number, row)) and has_mostly_numbers(below):
        actual = f"no numbers ({format_names(filter(None, row))})"
        expected = "a reading, or units that armd knows: deg, rad, mm, s, °C, …"
        raise BadInput(path, f"line {filled[0] + 1}", actual, expected)
    return header, first

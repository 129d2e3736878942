"""A table of readings as other programs write it: found out, and said, how it is to be read.

CSV of any separator, with a decimal comma or point, in any usual encoding; Excel's .xlsx.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from armd.errors import BadInput
from armd.files.inputs import read_input

#: Excel's own limit is a million rows; a person's table of readings has some thousand.
MOST_BYTES = 64 << 20
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "vertical bars"}
EXCEL = (".xlsx", ".xlsm")
_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")


@dataclass
class ForeignTable:
    """Cells as text; a number has a point."""

    path: Path
    header: list[str]
    rows: list[list[str]]
    assumed: list[str] = field(default_factory=list)
    """How it was read: a sentence each."""


def read_table(path: Path, sheet: str | None = None) -> ForeignTable:
    """Raises `BadInput` for what is no table with a header."""
    if path.suffix.lower() in EXCEL:
        cells, assumed = _excel(path, sheet)
    elif path.suffix.lower() == ".xls":
        raise BadInput(path, "the file", "Excel's format of before 2007", "it saved as .xlsx")
    else:
        cells, assumed = _text(path)
    begin = _header(cells)
    if begin is None or begin + 1 == len(cells):
        raise BadInput(path, "the table", "no rows", "a header and one row per reading")
    header = [cell.strip() for cell in cells[begin]]
    while header and not header[-1]:
        header.pop()
    if begin:
        assumed.append(f"line {begin + 1} is the header; what stands above it is left out")
    rows = []
    for number, row in enumerate(cells[begin + 1 :], begin + 2):
        if not any(row):
            continue
        if any(row[len(header) :]):
            raise BadInput(path, f"line {number}", f"{len(row)} columns", f"{len(header)}")
        rows.append([*row, *[""] * (len(header) - len(row))][: len(header)])
    return ForeignTable(path, header, rows, assumed)


def _header(cells: Sequence[Sequence[str]]) -> int | None:
    """The line, from 0, of the header: above the first line of numbers the one with most cells, for
    a program may write its name or a date above it; without such a line the first of several."""
    lines = {i: row for i, row in enumerate(cells) if sum(map(bool, row)) > 1}
    numbers = next((i for i, row in lines.items() if sum(map(_is_number, row)) > 1), None)
    above = {i: row for i, row in lines.items() if numbers is not None and i < numbers}
    return max(above, key=lambda i: sum(map(bool, above[i])), default=next(iter(lines), None))


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def _text(path: Path) -> tuple[list[list[str]], list[str]]:
    content = read_input(path, MOST_BYTES)
    assumed = []
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        text = content.decode("utf-16", "replace")
        assumed.append("the text is UTF-16")
    else:
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = content.decode("cp1252", "replace")
            assumed.append("the text is in Windows' western encoding (cp1252)")
    if "\0" in text:
        raise BadInput(path, "the file", "no text", "a table as text, or .xlsx")
    lines = [line for line in text.splitlines() if line.strip()]
    separator = max(SEPARATORS, key=lambda mark: _columns(lines, mark))
    assumed.append(f"columns are separated by {SEPARATORS[separator]}")
    try:
        cells = list(csv.reader(io.StringIO(text, newline=""), delimiter=separator))
    except csv.Error as error:
        raise BadInput(path, "the table", str(error), "a table as text") from error
    stripped = [[cell.strip() for cell in row] for row in cells]
    return (stripped if separator == "," else _with_points(stripped, assumed)), assumed


def _columns(lines: Sequence[str], mark: str) -> tuple[int, bool, int]:
    """How well *mark* parts these lines: how many of them alike, and into how many columns.

    The header counts too: a decimal comma stands in every row, and not there.
    """
    counts = Counter(line.count(mark) for line in lines if mark in line)
    often, lines_alike = max(counts.items(), key=lambda one: one[1], default=(0, 0))
    return lines_alike, mark != ",", often


def _with_points(cells: list[list[str]], assumed: list[str]) -> list[list[str]]:
    """Numbers with a decimal comma have a point, and *assumed* says so if there are any."""
    if not any(_DECIMAL_COMMA.fullmatch(cell) for row in cells for cell in row):
        return cells
    assumed.append("numbers have a decimal comma")
    return [[c.replace(",", ".") if _DECIMAL_COMMA.fullmatch(c) else c for c in r] for r in cells]


def _excel(path: Path, sheet: str | None) -> tuple[list[list[str]], list[str]]:
    try:
        import openpyxl
    except ImportError as error:
        expected = "it installed (pip install openpyxl), or the sheet saved as CSV"
        raise BadInput(path, "the package openpyxl", "nothing", expected) from error
    content = read_input(path, MOST_BYTES)
    try:
        book = openpyxl.load_workbook(io.BytesIO(content), read_only=True, data_only=True)
    except Exception as error:  # zip, XML, and openpyxl's own
        raise BadInput(path, "the file", f"no workbook ({error})", "an .xlsx file") from error
    names = book.sheetnames
    if sheet is not None and sheet not in names:
        raise BadInput(path, "--sheet", repr(sheet), f"one of {', '.join(names)}")
    chosen = sheet or names[0]
    assumed = [] if sheet or len(names) == 1 else [f"the readings are on the sheet {chosen!r}"]
    rows = book[chosen].iter_rows(values_only=True)
    cells = [["" if cell is None else str(cell).strip() for cell in row] for row in rows]
    return _with_points(cells, assumed), assumed  # as text a cell keeps the comma it came with

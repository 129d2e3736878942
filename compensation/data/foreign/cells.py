"""Cells of a table of another program as text: numbers as they are written, and limits."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from armd.compensation.data.foreign.words import MISSING
from armd.errors import BadInput

Cells = list[list[str]]

#: The most cells of a table: some 100 columns of a hundred thousand readings; each takes some 60
#: bytes.
MOST_CELLS = 10_000_000
#: Excel's own limits of columns in a row, and of letters in a cell.
MOST_COLUMNS = 16_384
MOST_LETTERS = 32_767
#: Other minus signs: mainly U+2212, and those that Word makes of it.
MINUS = re.compile("^[\u2212\u2010\u2011\u2012\u2013\ufe63\uff0d](?=[.,]?\\d)")
_EXPONENT = re.compile("(?<=[eE])[\u2212\u2013](?=\\d)")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")


def check_size(path: Path, cells: Cells) -> None:
    """Raise `BadInput` for a table, a row or a cell that is too large."""
    if sum(map(len, cells)) > MOST_CELLS:
        raise BadInput(path, "the table", f"{sum(map(len, cells))} cells", f"{MOST_CELLS} at most")
    for number, row in enumerate(cells, 1):
        if len(row) > MOST_COLUMNS:
            actual = f"{len(row)} columns"
            raise BadInput(path, f"line {number}", actual, f"{MOST_COLUMNS} at most")
        if max(map(len, row), default=0) > MOST_LETTERS:
            actual = f"a cell of {max(map(len, row))} letters"
            raise BadInput(path, f"line {number}", actual, f"{MOST_LETTERS} at most")


def use_points(cells: Cells, assumed: list[str], *, decimal_comma: bool = True) -> Cells:
    """Return the cells with plain minus signs and decimal points, and add the changes
    to *assumed*.
    """
    with_minus = [[_with_minus(cell) for cell in row] for row in cells]
    if with_minus != cells:
        assumed.append("minus signs of other characters (as U+2212) are minus signs")
    if not decimal_comma or not any(
        _DECIMAL_COMMA.fullmatch(cell) for row in with_minus for cell in row
    ):
        return with_minus
    assumed.append("numbers have a decimal comma")
    return [[replace_comma(cell) for cell in row] for row in with_minus]


def replace_comma(cell: str) -> str:
    """Replace the decimal comma of a number by a point; return any other cell unchanged."""
    return cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell


def _with_minus(cell: str) -> str:
    """Replace a number's minus sign by that of a keyboard."""
    if cell.isascii():
        return cell
    return _EXPONENT.sub("-", MINUS.sub("-", cell))


def parse_number(cell: str) -> float | None:
    """Return the number in a cell, NaN for a word for missing, None for anything else."""
    if cell.lower() in MISSING:
        return float("nan")
    try:
        return float(_with_minus(cell).replace("_", "x"))  # refuse Python's 1_000
    except ValueError:
        return None


def is_number(cell: str) -> bool:
    """Return whether a cell is a number that is not missing."""
    return cell.lower() not in MISSING and parse_number(cell) is not None


def has_mostly_numbers(row: Sequence[str]) -> bool:
    """Return whether two or more cells, and at least half of the non-empty ones, are numbers."""
    filled = [cell for cell in row if cell]
    numbers = sum(map(is_number, filled))
    return numbers > 1 and 2 * numbers >= len(filled)

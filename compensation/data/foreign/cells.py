"""Cells of a table of another program, as text: numbers as they are written, and limits."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from armd.compensation.data.foreign.words import MISSING
from armd.errors import BadInput

Cells = list[list[str]]

#: Some 100 columns of a hundred thousand readings; each cell takes some 60 bytes.
MOST_CELLS = 10_000_000
#: Excel's own limits of a row, and of a cell's letters.
MOST_COLUMNS = 16_384
MOST_LETTERS = 32_767
#: What other programs write for the minus of a number: U+2212 above all, and what Word makes of it.
MINUS = re.compile("^[\u2212\u2010\u2011\u2012\u2013\ufe63\uff0d](?=[.,]?\\d)")
_EXPONENT = re.compile("(?<=[eE])[\u2212\u2013](?=\\d)")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")


def check_size(path: Path, cells: Cells) -> None:
    """Raise `BadInput` for a row or a cell that no table of a person has."""
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
    """Numbers with a plain minus sign and a decimal point, and *assumed* says what was changed."""
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
    """A number with its decimal comma as a point; any other cell as it stands."""
    return cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell


def _with_minus(cell: str) -> str:
    """A number whose minus sign is another character has the one that a keyboard has."""
    if cell.isascii():
        return cell
    return _EXPONENT.sub("-", MINUS.sub("-", cell))


def parse_number(cell: str) -> float | None:
    """The number in a cell, NaN where it says that there is none, None where it is no number."""
    if cell.lower() in MISSING:
        return float("nan")
    try:
        return float(_with_minus(cell).replace("_", "x"))  # Python's 1_000 is nobody's number
    except ValueError:
        return None


def is_number(cell: str) -> bool:
    """Whether it is one, and not missing."""
    return cell.lower() not in MISSING and parse_number(cell) is not None


def has_mostly_numbers(row: Sequence[str]) -> bool:
    """Whether two or more cells, and at least half of those that are not empty, are numbers."""
    filled = [cell for cell in row if cell]
    numbers = sum(map(is_number, filled))
    return numbers > 1 and 2 * numbers >= len(filled)

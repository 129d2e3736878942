"""Reads the cells of a table as text; its encoding and its separator are detected."""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from armd.compensation.data.foreign.cells import (
    MOST_CELLS,
    MOST_COLUMNS,
    Cells,
    check_size,
    is_number,
    replace_comma,
    use_points,
)
from armd.errors import BadInput
from armd.files.inputs import read_input

#: The largest file: Excel's own limit is a million rows, and tables of readings have some thousand.
MOST_BYTES = 64 << 20
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "vertical bars"}
SPACES = {r"\s{2,}": "two spaces or more", r"\s+": "spaces"}
#: The number of lines whose columns are counted to detect the separator.
MOST_LOOKED_AT = 1000
#: The mark that numpy writes before a header.
COMMENT = re.compile(r"^\s*[#%]\s+(?=\S)|^\s*#(?=\S)")


def read_text(path: Path) -> tuple[Cells, list[str]]:
    """Return rows of stripped cells, and how they were read, a sentence each; raises `BadInput`."""
    text, assumed = _decoded(path)
    lines = [line for line in text.splitlines() if line.strip()]
    separator = max(SEPARATORS, key=lambda mark: _how_well(lines, mark))
    widest = 1 + max((line.count(separator) for line in lines), default=0)
    if widest > MOST_COLUMNS:
        raise BadInput(path, "the table", f"{widest} columns", f"{MOST_COLUMNS} at most")
    spaces = max(SPACES, key=lambda mark: _share_of_numbers(lines, mark))
    # If both kinds of spaces fit equally, two or more are used, so that names of several words stay
    # whole.
    by_spaces = _share_of_numbers(lines, spaces) > _share_of_numbers(lines, re.escape(separator))
    if by_spaces:
        assumed.append(f"columns are separated by {SPACES[spaces]}")
        cells = [_split(line, spaces) if line.strip() else [] for line in text.splitlines()]
    else:
        assumed.append(f"columns are separated by {SEPARATORS[separator]}")
        if text.count(separator) > MOST_CELLS:
            actual = f"{text.count(separator)} cells"
            raise BadInput(path, "the table", actual, f"{MOST_CELLS} at most")
        try:
            cells = list(csv.reader(io.StringIO(text, newline=""), delimiter=separator))
        except csv.Error as error:
            raise BadInput(path, "the table", str(error), "a table as text") from error
        cells = [[cell.strip() for cell in row] for row in cells]
    check_size(path, cells)
    assumed_comma = separator == "," and not by_spaces
    return use_points(cells, assumed, decimal_comma=not assumed_comma), assumed


def _decoded(path: Path) -> tuple[str, list[str]]:
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
    return text, assumed


def _how_well(lines: Sequence[str], mark: str) -> tuple[int, bool, int]:
    """Return how well *mark* separates these lines: the number of equal lines, and of their
    columns.

    The header counts, too: a decimal comma occurs in every row, but not there.
    """
    counts = Counter(line.count(mark) for line in lines if mark in line)
    often, lines_alike = max(counts.items(), key=lambda item: item[1], default=(0, 0))
    return lines_alike, mark != ",", often


def _share_of_numbers(lines: Sequence[str], pattern: str) -> float:
    """Return the share of numbers among the cells that *pattern* separates; 0 for a single column.

    Only lines with the most frequent number of cells count.
    """
    rows = [_split(line, pattern) for line in lines[:MOST_LOOKED_AT]]
    columns, _ = Counter(map(len, rows)).most_common(1)[0] if rows else (1, 0)
    if columns == 1:
        return 0.0
    cells = [cell.strip() for row in rows if len(row) == columns for cell in row]
    numbers = sum(is_number(replace_comma(cell) if pattern != "," else cell) for cell in cells)
    return numbers / max(len(cells), 1)


def _split(line: str, pattern: str) -> list[str]:
    return re.split(pattern, COMMENT.sub("", line).strip())

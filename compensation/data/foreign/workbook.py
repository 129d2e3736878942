"""Reads all cells of one sheet of an Excel workbook, within limits.

A workbook is a zip of foreign XML. Its unpacked size is checked first, because some hundred
kilobytes may unpack to a cell of hundreds of megabytes.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from armd.compensation.data.foreign.cells import (
    MOST_CELLS,
    MOST_COLUMNS,
    MOST_LETTERS,
    Cells,
    check_size,
    use_points,
)
from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.terminal.suggest import format_names, suggest_names

EXCEL = (".xlsx", ".xlsm")
MOST_BYTES = 64 << 20
#: The most bytes of XML in all parts: a million readings of ten columns take some 300 MB.
MOST_UNPACKED = 1 << 29
MOST_PARTS = 10_000
#: The most bytes between two brackets of XML: a cell's text, with letters of four bytes and escaped
#: ones.
MOST_TEXT = 8 * MOST_LETTERS
_BLOCK = 1 << 18


def read_workbook(path: Path, sheet: str | None) -> tuple[Cells, list[str]]:
    """Return rows of stripped cells, and the assumptions, a sentence each; raises `BadInput`."""
    try:
        import openpyxl
    except ImportError as error:
        expected = "it installed (pip install openpyxl), or the sheet saved as CSV"
        raise BadInput(path, "the package openpyxl", "nothing", expected) from error
    content = read_input(path, MOST_BYTES)
    try:
        _check_parts(path, content)
        book = openpyxl.load_workbook(io.BytesIO(content), read_only=True, data_only=True)
        names = [name for name in book.sheetnames if hasattr(book[name], "iter_rows")]
    except BadInput:
        raise
    except Exception as error:  # zip, XML, and openpyxl's own
        raise _no_workbook(path, error) from error
    if not names:
        raise BadInput(path, "the file", "no sheet with cells", "a sheet with a table")
    if sheet is not None and sheet not in names:
        raise BadInput(
            path, "--sheet", repr(sheet), f"one of its sheets{suggest_names(sheet, names)}"
        )
    chosen = sheet or names[0]
    assumed = [] if sheet or len(names) == 1 else [_which_sheet(chosen, names)]
    try:
        cells = list(_rows(path, book[chosen]))
    except BadInput:
        raise
    except Exception as error:
        raise _no_workbook(path, error) from error
    check_size(path, cells)
    return use_points(cells, assumed), assumed  # a cell of text keeps its decimal comma


def _rows(path: Path, sheet: Any) -> Iterator[list[str]]:
    """Yield the rows, ignoring the size that the sheet states, which may be wrong."""
    sheet.reset_dimensions()
    count = 0
    for row in sheet.iter_rows(values_only=True):
        while row and row[-1] is None:
            row = row[:-1]
        if len(row) > MOST_COLUMNS:
            raise BadInput(path, "the sheet", f"{len(row)} columns", f"{MOST_COLUMNS} at most")
        count += 1 + len(row)
        if count > MOST_CELLS:
            raise BadInput(path, "the sheet", f"over {MOST_CELLS} cells", f"{MOST_CELLS} at most")
        yield ["" if cell is None else str(cell).strip() for cell in row]


def _which_sheet(chosen: str, names: list[str]) -> str:
    other_names = format_names(name for name in names if name != chosen)
    return f"the readings are on the sheet {chosen!r} (--sheet; there is also {other_names})"


def _no_workbook(path: Path, error: Exception) -> BadInput:
    reason = " ".join(str(error).split()) or type(error).__name__
    return BadInput(path, "the file", f"no workbook that can be read ({reason})", "an .xlsx file")


def _check_parts(path: Path, content: bytes) -> None:
    """Raise `BadInput` for a workbook that unpacks to an implausible size."""
    with zipfile.ZipFile(io.BytesIO(content)) as parts:
        listed = parts.infolist()
        if len(listed) > MOST_PARTS:
            raise BadInput(path, "the file", f"{len(listed)} parts", f"{MOST_PARTS} at most")
        unpacked = sum(part.file_size for part in listed)
        if unpacked > MOST_UNPACKED:
            actual = f"{unpacked} bytes of XML in {len(content)} bytes"
            raise BadInput(path, "the file", actual, f"{MOST_UNPACKED} at most")
        for part in listed:
            if part.filename.endswith((".xml", ".rels")):
                with parts.open(part) as xml:
                    _check_xml(path, part.filename, xml)


def _check_xml(path: Path, name: str, xml: Any) -> None:
    """Raise `BadInput` for a declaration of entities, and for text longer than a cell's."""
    since = 0
    before = b""
    while block := xml.read(_BLOCK):
        if b"<!DOCTYPE" in before + block or b"<!ENTITY" in before + block:
            raise BadInput(path, name, "a document type or entity", "a workbook's plain XML")
        first, *after = block.split(b"<")
        longest = max(since + len(first), *map(len, after)) if after else since + len(first)
        if longest > MOST_TEXT:
            expected = f"{MOST_LETTERS} letters at most, Excel's own limit"
            raise BadInput(path, name, f"a cell of {longest} bytes or more", expected)
        since = len(after[-1]) if after else since + len(first)
        before = block[-16:]

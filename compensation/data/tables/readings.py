"""Tables of readings, CSV or Parquet: columns as arrays, faults located by row and column.

Arrow parses the file. Only a file that Arrow refuses is read a second time, as text, to find the
faulty cell.
"""

from __future__ import annotations

import codecs
import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet

from armd.arrays import F64, I64, Mask
from armd.compensation.data.tables.arrow_columns import encode_in_order, to_codes, to_numbers
from armd.compensation.data.tables.header import check_header
from armd.compensation.data.tables.within import LARGEST, is_within
from armd.errors import BadInput
from armd.files.inputs import check_input, open_input
from armd.printable import escape_invisible
from armd.terminal.suggest import format_names, suggest

MISSING = ("", "nan", "NaN", "NAN")
#: Separators of tables that Excel writes where a comma is the decimal point.
SEPARATORS = {";": "semicolons", "\t": "tabs"}
#: A longer line is not a row of a table; the file holds something else.
LONGEST_LINE_BYTES = 1 << 16


@dataclass(frozen=True)
class Readings:
    """The requested columns of a table, and the names of all its columns."""

    path: Path
    header: list[str]
    table: pa.Table
    first_row: int = 0  # of the table within the file, if it is read in pieces

    @property
    def n(self) -> int:
        return int(self.table.num_rows)

    def has(self, name: str) -> bool:
        return name in self.header

    def unchecked(self, name: str) -> F64:
        """Return a column like `number`, for a caller that checks it against its own limits."""
        self._must_have(name)
        column = self.table[name]  # combining would copy a single chunk
        chunk = column.chunk(0) if column.num_chunks == 1 else column.combine_chunks()
        return to_numbers(chunk)

    def number(self, name: str) -> F64:
        """Return a column of numbers (n,), NaN where missing; raises `BadInput` without such a
        column.
        """
        numbers = self.unchecked(name)
        if is_within(numbers, -LARGEST, LARGEST):
            return numbers
        if infinite := _first(np.isinf(numbers)):
            raise self.fault(infinite - 1, name, "an infinite value", "a finite number")
        return numbers

    def required(self, name: str) -> F64:
        """Return a column of numbers (n,); raises `BadInput` if one is missing."""
        numbers = self.number(name)
        if is_within(numbers, -LARGEST, LARGEST):
            return numbers
        if missing := _first(np.isnan(numbers)):
            raise self.fault(missing - 1, name, "nothing", "a number")
        return numbers

    def optional(self, name: str) -> F64:
        """Return a column of numbers (n,), all NaN if there is no such column."""
        return self.number(name) if self.has(name) else np.full(self.n, np.nan)

    def names(self, name: str) -> tuple[I64, list[str]]:
        """Return a column of names as indices (n,) into the list of distinct names, and that list.

        The list is in the order of their occurrence.
        """
        self._must_have(name)
        column = self.table[name].combine_chunks()
        encoded = encode_in_order(column)
        names = [str(text) for text in encoded.dictionary.to_pylist()]
        if column.null_count or not set(MISSING).isdisjoint(names):
            column = column.cast(pa.string())
            missing = pc.or_(pc.is_null(column), pc.is_in(column, pa.array(MISSING)))
            if row := _first(missing.to_numpy(zero_copy_only=False)):
                raise self.fault(row - 1, name, "nothing", f"the name of a {name}")
        indices = to_codes(encoded)
        for code, text in enumerate(names):
            if hidden := escape_invisible(text):
                row = int(np.argmax(indices == code))
                raise self.fault(row, name, f"the character {hidden}", "a name that can be read")
        return indices, names

    def fault(self, row: int, column: str, actual: str, expected: str) -> BadInput:
        """Return an error about one cell; *row* counts from 0, messages count from 1."""
        location = f"{describe_row(self.path, row + self.first_row)}, column {column}"
        return BadInput(self.path, location, actual, expected)

    def refuse(self, bad: Mask, column: str, values: F64, expected: str) -> None:
        """Raise the error of the first row that is *bad* (n,), if any."""
        if row := _first(bad):
            raise self.fault(row - 1, column, f"{values[row - 1]:g}", expected)

    def _must_have(self, name: str) -> None:
        if not self.has(name):
            suggestion = suggest(name, self.header).replace("did you mean", "is it")
            actual = (
                "no such column"
                if suggestion
                else f"no such column among {format_names(self.header)}"
            )
            raise BadInput(self.path, f"column {name}", actual, f"this column{suggestion}")


def describe_row(path: Path, row: int) -> str:
    """Describe a row of the table *path*, counted from 0, as people count it, and its line."""
    line = f" (line {row + 2})" if path.suffix == ".csv" else ""
    return f"row {row + 1}{line}"


def load_readings(path: Path, numbers: list[str], texts: list[str]) -> Readings:
    """Read those of the named columns that *path* has; raises `BadInput` naming row and column."""
    header = read_header(path)
    types = select_columns(header, numbers, texts)
    if path.suffix == ".csv":
        table = parse_csv(path, path, header, types)
        check_quotes(path, table.num_rows)
    else:
        table = _parquet_table(path, [name for name in header if name in types])
        table = convert_columns(path, table, types)
    if table.num_rows == 0:
        raise refuse_empty(path)
    return Readings(path, header, table)


def select_columns(
    header: list[str], numbers: list[str], texts: list[str]
) -> dict[str, pa.DataType]:
    """Return the named columns that are in the header, with their types."""
    types = {name: pa.float64() for name in numbers if name in header}
    return types | {name: pa.string() for name in texts if name in header}


def refuse_empty(path: Path) -> BadInput:
    return BadInput(path, "the file", "no readings", "at least one row")


def read_header(path: Path) -> list[str]:
    """Return the names of the columns of a CSV or Parquet file; raises `BadInput` for a
    name twice.
    """
    header = _csv_header(path) if path.suffix == ".csv" else _parquet_header(path)
    check_header(path, header)
    return header


def _csv_header(path: Path) -> list[str]:
    with open_input(path) as file:
        line = file.readline(LONGEST_LINE_BYTES + 1)
    if line.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        expected = "UTF-8: in Excel, save as `CSV UTF-8`"
        raise BadInput(path, "byte 0", "UTF-16 text", expected)
    if len(line) > LONGEST_LINE_BYTES:
        expected = f"a header of {LONGEST_LINE_BYTES} bytes at most"
        raise BadInput(path, "line 1", "a longer line", expected)
    try:
        header = [name.strip() for name in next(csv.reader([line.decode("utf-8-sig")]), [])]
    except (UnicodeDecodeError, csv.Error) as error:
        raise BadInput(path, "the header", str(error), "a CSV header in UTF-8") from error
    if not header:
        raise BadInput(path, "the file", "nothing", "a header and one row per reading")
    for mark, name in SEPARATORS.items():
        if len(header) == 1 and header[0].count(mark) > 1:
            expected = "commas, and points in numbers: `armd import` reads such tables"
            raise BadInput(path, "the header", f"columns separated by {name}", expected)
    return header


def parse_csv(
    path: Path, source: Path | io.BytesIO, header: list[str], types: dict[str, pa.DataType]
) -> pa.Table:
    """Parse the wanted columns of *source*: the file *path* with its header, or rows out of it."""
    try:
        return pa.csv.read_csv(
            source,
            read_options=pa.csv.ReadOptions(
                column_names=header, skip_rows=0 if isinstance(source, io.BytesIO) else 1
            ),
            convert_options=convert_options(types),
        )
    except pa.ArrowInvalid as error:
        raise explain(path, header, types, error) from error


def convert_options(types: dict[str, pa.DataType]) -> pa.csv.ConvertOptions:
    """Return Arrow's options for the wanted columns of a CSV file, and no others."""
    return pa.csv.ConvertOptions(
        column_types=types,
        include_columns=list(types),
        null_values=list(MISSING),
        strings_can_be_null=False,
    )


def explain(
    path: Path, header: list[str], types: dict[str, pa.DataType], error: pa.ArrowInvalid
) -> BadInput:
    """Find the faulty cell (or ragged row) by reading the file as text."""
    rows = csv.reader(_lines(path))
    try:
        next(rows)
        for i, row in enumerate((row for row in rows if row), 1):
            location = f"row {i} (line {rows.line_num})"
            if len(row) != len(header):
                return BadInput(path, location, f"{len(row)} columns", f"{len(header)}")
            for name, cell in zip(header, row, strict=True):
                if types.get(name) == pa.float64() and not _is_number(cell):
                    return BadInput(
                        path, f"{location}, column {name}", _abbreviate(cell), "a number"
                    )
    except csv.Error as fault:
        return BadInput(path, f"line {rows.line_num}", str(fault), "a row of a CSV table")
    return BadInput(path, "the file", str(error), "a CSV table")


def check_quotes(path: Path, rows: int) -> None:
    """Raise `BadInput` for a quotation mark that is never closed.

    Arrow takes the rest of the file for its text, and the missing rows would not be noticed.
    """
    with open_input(path) as file:
        lines = sum(1 for line in file if line.strip())
    if lines == rows + 1:
        return
    table = csv.reader(_lines(path), strict=True)
    try:
        for _ in table:
            pass
    except csv.Error as fault:
        location = f"line {table.line_num}"
        raise BadInput(path, location, str(fault), "every quotation mark closed") from fault


def _lines(path: Path) -> Iterator[str]:
    """Yield the lines of a text file; raises `BadInput` for one that is too long."""
    with open_input(path) as file:
        text = io.TextIOWrapper(file, encoding="utf-8-sig", errors="replace", newline="")
        number = 0
        while line := text.readline(LONGEST_LINE_BYTES + 1):
            number += 1
            if len(line) > LONGEST_LINE_BYTES:
                expected = f"a row of {LONGEST_LINE_BYTES} characters at most"
                raise BadInput(path, f"line {number}", "a longer line", expected)
            yield line


def _abbreviate(cell: str) -> str:
    return repr(cell if len(cell) <= 80 else cell[:77] + "...")


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return cell in MISSING
    return True


def _parquet_header(path: Path) -> list[str]:
    check_input(path)
    try:
        return [str(name) for name in pa.parquet.read_schema(path).names]
    except (OSError, pa.ArrowException) as error:
        raise refuse_damaged(path, error) from error


def _parquet_table(path: Path, names: list[str]) -> pa.Table:
    try:
        return pa.parquet.read_table(path, columns=names)
    except (OSError, pa.ArrowException) as error:
        raise refuse_damaged(path, error) from error


def refuse_damaged(path: Path, error: Exception) -> BadInput:
    """Return an error with Arrow's message about a Parquet file that it cannot read, in
    one line.
    """
    return BadInput(path, "the file", " ".join(str(error).split()), "a Parquet table")


def convert_columns(path: Path, table: pa.Table, types: dict[str, pa.DataType]) -> pa.Table:
    """Return the wanted columns of *table*, in their wanted types."""
    table = table.select([name for name in table.column_names if name in types])
    for i, (name, kind) in enumerate(zip(table.column_names, table.schema.types, strict=True)):
        if kind == types[name] or kind == pa.dictionary(pa.int32(), types[name]):
            continue  # `names` uses the numbers of a dictionary
        if pa.types.is_boolean(kind):  # Arrow would cast it: true would be 1 rad
            raise BadInput(path, f"column {name}", str(kind), str(types[name]))
        try:
            table = table.set_column(i, name, table[name].cast(types[name]))
        except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as error:
            raise BadInput(path, f"column {name}", str(kind), str(types[name])) from error
    return table


def _first(bad: Mask) -> int:
    """Return one more than the index of the first true row, or 0 if there is none."""
    return int(np.argmax(bad)) + 1 if bad.any() else 0

"""Reads tables of readings in pieces, so that memory does not grow with the file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from armd.compensation.data.tables.readings import (
    LONGEST_LINE_BYTES,
    Readings,
    check_quotes,
    convert_columns,
    convert_options,
    explain,
    read_header,
    refuse_damaged,
    refuse_empty,
    select_columns,
)
from armd.errors import BadInput

#: The size of a piece. Several pieces are in use at a time, and the allocator keeps as much memory
#: of finished ones, so small pieces keep the total small.
PIECE_BYTES = 8 << 20
PIECE_ROWS = 1 << 14


def read_pieces(path: Path, numbers: list[str], texts: list[str]) -> Iterator[Readings]:
    """Yield the readings of `load_readings` in consecutive pieces, none of them empty."""
    header = read_header(path)
    types = select_columns(header, numbers, texts)
    done = 0
    tables = _csv_tables if path.suffix == ".csv" else _parquet_tables
    for table in tables(path, header, types):
        if table.num_rows:
            yield Readings(path, header, table, done)
            done += table.num_rows
    if path.suffix == ".csv":
        check_quotes(path, done)
    if done == 0:
        raise refuse_empty(path)


def _csv_tables(path: Path, header: list[str], types: dict[str, pa.DataType]) -> Iterator[pa.Table]:
    options = pa.csv.ReadOptions(column_names=header, skip_rows=1, block_size=PIECE_BYTES)
    try:
        with pa.csv.open_csv(
            path, read_options=options, convert_options=convert_options(types)
        ) as batches:
            for batch in batches:
                yield pa.Table.from_batches([batch])
    except pa.ArrowInvalid as error:
        raise explain(path, header, types, error) from error


def _parquet_tables(
    path: Path, header: list[str], types: dict[str, pa.DataType]
) -> Iterator[pa.Table]:
    with open_parquet(path, [name for name, kind in types.items() if kind == pa.string()]) as file:
        for table in read_parquet_pieces(path, file, [name for name in header if name in types]):
            yield convert_columns(path, table, types)


def open_parquet(path: Path, names: Sequence[str] = ()) -> pa.parquet.ParquetFile:
    """Open a Parquet file; text in columns of *names* is read as its dictionary's numbers.

    Reading ahead is off, because Arrow would keep all that it has read of the file.
    """
    file = pa.parquet.ParquetFile(path, pre_buffer=False)
    texts = [name for name in names if file.schema_arrow.field(name).type == pa.string()]
    if not texts:
        return file
    file.close()
    return pa.parquet.ParquetFile(
        path, metadata=file.metadata, read_dictionary=texts, pre_buffer=False
    )


def read_parquet_pieces(
    path: Path, file: pa.parquet.ParquetFile, columns: Sequence[str] | None = None
) -> Iterator[pa.Table]:
    """Yield the file in pieces; raises `BadInput` at a damaged page."""
    # With pieces this small, Arrow's own threads take up to twice the processor time.
    batches = file.iter_batches(PIECE_ROWS, columns=columns, use_threads=False)
    while True:
        try:
            batch = next(batches, None)
        except (OSError, pa.ArrowException) as error:
            raise refuse_damaged(path, error) from error
        if batch is None:
            return
        yield pa.Table.from_batches([batch])


def read_line_pieces(source: Path, file: BinaryIO) -> Iterator[list[bytes]]:
    """Yield whole lines without their ends, as many as one read contains.

    Raises `BadInput` for a line longer than `LONGEST_LINE_BYTES`.
    """
    begun = b""
    while block := file.read(PIECE_BYTES):
        *lines, begun = (begun + block).split(b"\n")
        if len(begun) > LONGEST_LINE_BYTES:
            expected = f"rows of {LONGEST_LINE_BYTES} bytes at most"
            raise BadInput(source, "the file", "a longer line", expected)
        yield lines
    yield [begun]

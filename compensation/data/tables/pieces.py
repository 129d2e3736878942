"""Tables of readings in pieces, so that memory does not grow with the file."""

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

#: What is read at once. Several pieces are in work or wait at a time, and what the allocator keeps
#: of those that are done is as large again: small ones make the whole small.
PIECE_BYTES = 8 << 20
PIECE_ROWS = 1 << 14


def read_pieces(path: Path, numbers: list[str], texts: list[str]) -> Iterator[Readings]:
    """What `load_readings` gives, in pieces that follow each other, none of them empty."""
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
    """Columns of *names* come as the numbers that they are stored as, if they hold text.

    Read ahead, Arrow would keep all of the file that it has read.
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
    """Raises `BadInput` at a damaged page."""
    # Of pieces this small, threads of Arrow's own take up to twice the processor time.
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
    """Whole lines without their ends, as many as come in one read; none of them endless."""
    begun = b""
    while block := file.read(PIECE_BYTES):
        *lines, begun = (begun + block).split(b"\n")
        if len(begun) > LONGEST_LINE_BYTES:
            expected = f"rows of {LONGEST_LINE_BYTES} bytes at most"
            raise BadInput(source, "the file", "a longer line", expected)
        yield lines
    yield [begun]

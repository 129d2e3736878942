"""Writes tables as Parquet or CSV, and finds the column that a CSV file cannot hold."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from armd.errors import BadInput


def open_writer(
    source: Path, part: Path, suffix: str, schema: pa.Schema
) -> pa.parquet.ParquetWriter | pa.csv.CSVWriter:
    """Open a writer for the columns of *source* and new ones to *part*; the suffix decides the
    kind.
    """
    if suffix != ".parquet":
        with _columns_held(source, schema.empty_table()):
            return pa.csv.CSVWriter(part, schema)
    # Measured numbers hardly ever repeat; searching a dictionary for each took most of the time.
    repeated = [field.name for field in schema if not pa.types.is_floating(field.type)]
    return pa.parquet.ParquetWriter(part, schema, use_dictionary=repeated)


def write_group(
    source: Path, out: pa.parquet.ParquetWriter | pa.csv.CSVWriter, group: list[pa.Table]
) -> None:
    """Write tables as one; raises `BadInput` for a column that the file cannot hold."""
    rows = pa.concat_tables(group)
    with _columns_held(source, rows):
        out.write_table(rows)


class GroupWriter:
    """Writes groups of rows in a thread, while the next group is computed.

    One group is written at a time, and one waits, so memory stays constant. An error is raised by
    the next call, or at the end.
    """

    def __init__(self, source: Path, out: pa.parquet.ParquetWriter | pa.csv.CSVWriter) -> None:
        self._source, self._out = source, out
        self._thread = ThreadPoolExecutor(1)
        self._writing: Future[None] | None = None

    def __enter__(self) -> GroupWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self._thread.shutdown()

    def write(self, group: list[pa.Table]) -> None:
        """Start to write *group* as one; raises `BadInput` like `write_group`, for an earlier
        group.
        """
        self.wait()
        self._writing = self._thread.submit(write_group, self._source, self._out, group)

    def wait(self) -> None:
        """Wait until all is written; raises `BadInput` like `write_group`."""
        if self._writing is not None:
            self._writing.result()


@contextmanager
def _columns_held(source: Path, rows: pa.Table) -> Iterator[None]:
    """Convert an error of the block into a `BadInput` that names the column of *source*.

    Some columns of *rows* have no text in a CSV file (lists, bytes).
    """
    try:
        yield
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as error:
        for name in rows.column_names:
            try:
                pa.csv.write_csv(rows.select([name]), pa.BufferOutputStream())
            except (pa.ArrowInvalid, pa.ArrowNotImplementedError):
                kind = str(rows[name].type)
                expected = "a column that a .csv file can hold: -o OUT.parquet holds this one"
                raise BadInput(source, f"column {name}", kind, expected) from error
        raise

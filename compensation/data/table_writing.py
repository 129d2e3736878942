"""Tables out again, as Parquet or CSV, and which column a CSV file cannot hold."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from armd.errors import BadInput


def table_writer(
    source: Path, part: Path, suffix: str, schema: pa.Schema
) -> pa.parquet.ParquetWriter | pa.csv.CSVWriter:
    """What writes the columns of *source* and new ones to *part*; the suffix decides the kind."""
    if suffix != ".parquet":
        with _columns_held(source, schema.empty_table()):
            return pa.csv.CSVWriter(part, schema)
    # Hardly a measured number comes twice: looking each up in a dictionary took most of the time.
    repeated = [field.name for field in schema if not pa.types.is_floating(field.type)]
    return pa.parquet.ParquetWriter(part, schema, use_dictionary=repeated)


def write_group(
    source: Path, out: pa.parquet.ParquetWriter | pa.csv.CSVWriter, group: list[pa.Table]
) -> None:
    """Write tables as one; raises `BadInput` for a column that the file cannot hold."""
    rows = pa.concat_tables(group)
    with _columns_held(source, rows):
        out.write_table(rows)


@contextmanager
def _columns_held(source: Path, rows: pa.Table) -> Iterator[None]:
    """Within this `with`, that *rows* have no text in a CSV file (lists, bytes) is a `BadInput`
    that names the column of *source*."""
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

"""The correction of files of readings to the same tables with points, piece by piece.

So memory does not grow with the file. Several pieces are processed at once on all processors, while
the next is read and the last are written.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.csv

from armd.compensation.data.correction.correction import Corrector, Taken
from armd.compensation.data.correction.point_columns import COLUMNS, make_point_columns
from armd.compensation.data.in_order import keep_freed_memory, read_ahead, run_in_order
from armd.compensation.data.tables.pieces import open_parquet, read_line_pieces, read_parquet_pieces
from armd.compensation.data.tables.readings import Readings, convert_columns, parse_csv, read_header
from armd.compensation.data.tables.recorded import drop_published, is_recorded
from armd.compensation.data.tables.writing import GroupWriter, open_writer
from armd.errors import BadInput
from armd.files.inputs import open_input
from armd.files.writing import replace_file

#: Rows that are written as one group of a Parquet file. The file's end describes every group, and
#: these descriptions are in memory until then.
GROUP_ROWS = 1 << 16


def correct_file(
    source: Path, target: Path, corrector: Corrector, progress: Callable[[float], None]
) -> int:
    """Read *source* and write *target* whole or not at all; return the number of rows.

    CSV gives CSV, with its own text unchanged; Parquet gives Parquet or CSV, by the target's
    suffix. *progress* is called with the share done, 0 to 1.
    """
    header = read_header(source)
    csv_source = source.suffix == ".csv"
    if csv_source and target.suffix == ".parquet":
        raise BadInput(target, "-o", "a .parquet file", "a .csv file: the input is one")
    twice = [] if is_recorded(header) else sorted(set(COLUMNS) & set(header))
    if target.suffix == ".parquet" and twice:
        raise BadInput(source, f"column {twice[0]}", "it already", "a table without it")
    types = corrector.select_columns(header)
    keep_freed_memory()
    n = 0
    with replace_file(target) as part:
        if csv_source:
            pieces = _csv_pieces(source, part, header, types, corrector)
        else:
            pieces = _parquet_pieces(source, part, target.suffix, types, corrector)
        for n, share in pieces:  # noqa: B007 (the last one counts)
            progress(share)
        corrector.ended(source)
        if n == 0:
            raise BadInput(source, "the file", "no readings", "at least one row")
    return n


def _csv_pieces(
    source: Path,
    part: Path,
    header: list[str],
    types: dict[str, pa.DataType],
    corrector: Corrector,
) -> Iterator[tuple[int, float]]:
    """Yield the number of rows and the share of the file done so far."""
    done = 0
    with open_input(source) as lines, part.open("wb") as out:
        size = os.fstat(lines.fileno()).st_size
        names = lines.readline().rstrip(b"\r\n")
        out.write(names + b"," + ",".join(COLUMNS).encode() + b"\n")

        def take_pieces() -> Iterator[tuple[list[bytes], Taken, int]]:
            begun = 0
            for piece in read_line_pieces(source, lines):
                rows = [line for line in piece if line.strip()]  # a blank line is no row
                if not rows:
                    continue
                table = parse_csv(source, io.BytesIO(b"\n".join(rows) + b"\n"), header, types)
                if len(table) != len(rows):
                    actual = "a line break inside a value"
                    raise BadInput(source, f"after row {begun}", actual, "one line per row")
                new = corrector.take(Readings(source, header, table, begun))
                begun += len(rows)
                yield rows, new, lines.tell()

        def written(piece: tuple[list[bytes], Taken, int]) -> tuple[list[bytes], bytes, int]:
            rows, new, end = piece
            text = pa.BufferOutputStream()
            options = pa.csv.WriteOptions(include_header=False)
            pa.csv.write_csv(make_point_columns(*corrector.correct(new)), text, options)
            return rows, text.getvalue().to_pybytes(), end

        for rows, text, end in run_in_order(written, read_ahead(take_pieces())):
            added = text.splitlines(keepends=True)
            out.writelines(
                old.rstrip(b"\r") + b"," + new for old, new in zip(rows, added, strict=True)
            )
            done += len(rows)
            yield done, end / size


def _parquet_pieces(
    source: Path, part: Path, suffix: str, types: dict[str, pa.DataType], corrector: Corrector
) -> Iterator[tuple[int, float]]:
    """Yield the number of rows and the share of the file done so far."""
    done = 0
    with open_parquet(source) as file:
        old = file.schema_arrow
        added = [(name, pa.float64()) for name in COLUMNS[:-1]] + [(COLUMNS[-1], pa.uint32())]
        unpublished = drop_published(old.empty_table(), corrector.identity).schema
        schema = pa.schema([*unpublished, *pa.schema(added)])

        def take_pieces() -> Iterator[tuple[pa.Table, Taken]]:
            begun = 0
            for table in read_parquet_pieces(source, file):
                cast = convert_columns(source, table, types)
                yield table, corrector.take(Readings(source, old.names, cast, begun))
                begun += len(table)

        def corrected(piece: tuple[pa.Table, Taken]) -> pa.Table:
            table, new = piece
            table = drop_published(table, corrector.identity)
            columns = [*table.columns, *make_point_columns(*corrector.correct(new)).columns]
            return pa.Table.from_arrays(columns, schema=schema)

        with (
            open_writer(source, part, suffix, schema) as out,
            GroupWriter(source, out) as writer,
        ):
            group: list[pa.Table] = []
            for table in run_in_order(corrected, read_ahead(take_pieces())):
                group.append(table)
                if sum(map(len, group)) >= GROUP_ROWS:
                    writer.write(group)
                    group = []
                done += len(table)
                yield done, done / file.metadata.num_rows
            if group:
                writer.write(group)
            writer.wait()

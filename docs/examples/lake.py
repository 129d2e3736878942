"""Correct a lake of `armd record --lake` again, one arm and day at a time.

Copy this file beside your job; docs/how-to/scale.md runs it on Ray and Dask.
"""

import os
from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

import armd

ROWS_AT_ONCE = 1 << 20  # 150 MB in memory


def list_days(lake: str) -> list[str]:
    """The partitions of a lake, as `serial=A-1/day=2026-03-01`."""
    return sorted(str(day.relative_to(lake)) for day in Path(lake).glob("serial=*/day=*"))


def correct_day(lake: str, day: str, target: str, corrector: armd.Corrector) -> int:
    """Write TARGET/DAY/points.parquet whole or not at all; returns its rows, 0 if it is there."""
    out = Path(target, day, "points.parquet")
    if out.exists():
        return 0
    out.parent.mkdir(parents=True, exist_ok=True)
    part = out.with_name(f".{os.getpid()}.part")
    lead = _earlier_rows(Path(lake, day), corrector)
    writer, rows = None, 0
    for table in _tables(sorted(Path(lake, day).glob("*.parquet"))):
        following = table if lead is None else pa.concat_tables([lead, table])
        corrected = corrector(following).slice(len(following) - len(table))
        writer = writer or pq.ParquetWriter(part, corrected.schema)
        writer.write_table(corrected)
        lead, rows = corrector.lead_in(following), rows + len(table)
    if writer is not None:
        writer.close()
        part.replace(out)
    return rows


def _tables(files: list[Path]) -> Iterator[pa.Table]:
    """The rows of the files, in order, many at a time."""
    waiting: list[pa.Table] = []
    for file in files:
        waiting.append(pq.read_table(file, partitioning=None))
        if sum(map(len, waiting)) >= ROWS_AT_ONCE:
            yield pa.concat_tables(waiting)
            waiting = []
    if waiting:
        yield pa.concat_tables(waiting)


def _earlier_rows(day: Path, corrector: armd.Corrector) -> pa.Table | None:
    """The rows of earlier days that this day's first rows depend on, by lags and held values."""
    files = sorted(f for f in day.parent.glob("day=*/*.parquet") if f.parent.name < day.name)
    table, count = None, 1
    while files:
        files, last = files[:-count], files[-count:]
        read = [pq.read_table(file, partitioning=None) for file in last]
        table = pa.concat_tables(read if table is None else [*read, table])
        lead, count = corrector.lead_in(table), 2 * count
        if len(lead) < len(table):
            return lead
    return table

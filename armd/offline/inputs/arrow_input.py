"""Converts tables of pandas, polars or Arrow, and dicts of arrays, to Arrow tables."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from armd.errors import BadInput


def to_arrow_table(table: Any, name: str) -> pa.Table:
    """Return *table* as a `pyarrow.Table`; raises `BadInput`, which calls it *name*."""
    try:
        return _converted(table)
    except (pa.ArrowException, ValueError, TypeError, OverflowError) as error:
        expected = "a pandas, polars or Arrow table, or a dict of arrays of one length"
        message = " ".join(str(error).split())
        raise BadInput(name, "the table", message or type(table).__name__, expected) from error


def _converted(table: Any) -> pa.Table:
    if isinstance(table, pa.Table):
        return table
    if isinstance(table, pa.RecordBatch):
        return pa.Table.from_batches([table])
    if isinstance(table, Mapping):
        return pa.table({str(name): _column(values) for name, values in table.items()})
    if type(table).__module__.partition(".")[0] == "pandas":  # its index is no column
        return pa.Table.from_pandas(table, preserve_index=False)
    if hasattr(table, "__arrow_c_stream__") or hasattr(table, "__arrow_c_array__"):
        return pa.table(table)
    raise TypeError(f"a {type(table).__name__}")


def _column(values: Any) -> Any:
    if isinstance(values, pa.Array | pa.ChunkedArray):
        return values
    array = np.asarray(values)
    if array.ndim != 1:
        raise ValueError(f"an array of shape {array.shape}")
    return pa.array(array, from_pandas=True)

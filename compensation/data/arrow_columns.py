"""Columns of Arrow as arrays, without pandas, which Arrow's own way loads where it is installed."""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from armd.arrays import F64, I64


def numbers_of(column: pa.Array) -> F64:
    """Numbers (n,) of a column, NaN where missing."""
    if not len(column) or column.type != pa.float64():
        return np.asarray(column.to_numpy(zero_copy_only=False), dtype=np.float64)
    if not column.null_count:
        return np.asarray(np.from_dlpack(column), dtype=np.float64)
    is_there, values = column.buffers()
    rows = slice(column.offset, column.offset + len(column))
    numbers = np.frombuffer(values, dtype=np.float64)[rows].copy()
    bits = np.unpackbits(np.frombuffer(is_there, dtype=np.uint8), bitorder="little")
    numbers[bits[rows] == 0] = np.nan
    return numbers


def codes_of(encoded: pa.DictionaryArray) -> I64:
    """Indices (n,) of a dictionary column in which nothing is missing."""
    return np.asarray(np.from_dlpack(encoded.indices), dtype=np.int64)

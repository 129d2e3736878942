"""Converts columns of Arrow to arrays without pandas, which Arrow itself would load
if installed.
"""

from __future__ import annotations

import numpy as np
import pyarrow as pa

from armd.arrays import F64, I64

#: Up to this many names, each is searched for by itself.
FEW_NAMES = 16


def to_numbers(column: pa.Array) -> F64:
    """Return the numbers (n,) of a column, NaN where missing."""
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


def encode_in_order(column: pa.Array) -> pa.DictionaryArray:
    """Encode a column of names as numbers of its distinct names, in the order of
    their occurrence.
    """
    if not pa.types.is_dictionary(column.type):
        return column.dictionary_encode()
    names = column.dictionary
    few = 0 < len(names) <= FEW_NAMES and len(names.unique()) == len(names)
    if column.null_count or names.null_count or not few:
        return column.cast(pa.string()).dictionary_encode()
    codes = to_codes(column)
    first = {}  # row → code; a dictionary of Parquet has the names of other rows, too
    for code in range(len(names)):
        row = int(np.argmax(codes == code)) if len(codes) else 0
        if len(codes) and codes[row] == code:
            first[row] = code
    codes_in_order = [first[row] for row in sorted(first)]
    if codes_in_order == list(range(len(names))):
        return column
    number = np.zeros(len(names), np.int64)
    number[codes_in_order] = np.arange(len(codes_in_order))
    return pa.DictionaryArray.from_arrays(
        pa.array(number[codes]), names.take(pa.array(codes_in_order))
    )


def to_codes(encoded: pa.DictionaryArray) -> I64:
    """Return the indices (n,) of a dictionary column without missing values."""
    return np.asarray(np.from_dlpack(encoded.indices), dtype=np.int64)

"""A fast check whether all numbers of a column lie within limits."""

from __future__ import annotations

import sys

from armd.arrays import F64

#: the largest finite number
LARGEST = sys.float_info.max


def is_within(values: F64, low: float, high: float) -> bool:
    """Return whether all of *values* (n,) are numbers from *low* to *high*; much faster than a
    mask.
    """
    return bool(len(values) == 0 or (low <= values.min() and values.max() <= high))

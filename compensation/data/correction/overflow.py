"""Impossible positions, from a calibration's coefficients so large that numbers overflow."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.errors import BadInput

#: A million kilometres: no plausible coefficient leads there, and squares are still finite.
FARTHEST_MM = 1e12
#: The most rows that a message names.
MOST_NAMED = 5


def find_overflows(position_mm: F64) -> Mask:
    """Return a mask (n,) of positions (n, 3) that are not finite, or too far to be squared."""
    if len(position_mm) and np.abs(position_mm).max() < FARTHEST_MM:
        return np.zeros(len(position_mm), bool)
    in_range: Mask = np.all(np.abs(position_mm) < FARTHEST_MM, axis=1)
    return ~in_range


def refuse_overflow(session: str, row: I64, overflow: Mask) -> None:
    """Raise `BadInput` if any of a session's rows (n,), counted from 0, is in the
    mask *overflow*.
    """
    rows = row[overflow] + 1
    if not len(rows):
        return
    named = ", ".join(map(str, rows[:MOST_NAMED])) + ", …" * (len(rows) > MOST_NAMED)
    raise BadInput(
        session,
        f"row{'s' * (len(rows) > 1)} {named}",
        f"points that are not finite, in {len(rows)} of {len(row)} readings",
        "finite points: a constant or coefficient of the calibration is absurd",
    )

"""Grouping of the rows of one table by equal keys, in one pass."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.arrays import I64


def split_alike(keys: Sequence[I64], order_by: Sequence[I64] = ()) -> list[I64]:
    """Return the row numbers (m,) of each part in which all *keys* (n,) are equal, keys ascending.

    Within a part, rows are ordered by *order_by*, and then by number.
    """
    order = np.lexsort([*reversed(order_by), *reversed(keys)])
    if not len(order):
        return []
    is_edge = np.any([np.diff(key[order]) != 0 for key in keys], axis=0)
    return np.split(order, np.flatnonzero(is_edge) + 1)


def group_rows(session: I64, placement: I64, target: I64) -> dict[int, dict[int, I64]]:
    """Return the rows by session and placement, both ascending; those of a placement by target."""
    rows: dict[int, dict[int, I64]] = {}
    for part in split_alike([session, placement], [target]):
        of_session = rows.setdefault(int(session[part[0]]), {})
        of_session[int(placement[part[0]])] = part
    return rows

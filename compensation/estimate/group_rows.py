"""Rows of one table by session and placement, found in one pass."""

from __future__ import annotations

import numpy as np

from armd.arrays import I64


def group_rows(session: I64, placement: I64, target: I64) -> dict[int, dict[int, I64]]:
    """Rows of each placement of each session, both ascending, a placement's ordered by target."""
    rows: dict[int, dict[int, I64]] = {}
    order = np.lexsort((target, placement, session))
    edges = np.flatnonzero((np.diff(session[order]) != 0) | (np.diff(placement[order]) != 0)) + 1
    for part in np.split(order, edges) if len(order) else []:
        of_session = rows.setdefault(int(session[part[0]]), {})
        of_session[int(placement[part[0]])] = part
    return rows

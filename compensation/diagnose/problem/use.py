"""What went before each reading: how warm a joint is of its use, from rates or ways, and how far it
is wound up."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.effects.effect import Use, Winding
from armd.compensation.model.state import States


def evaluated(history: Use | Winding, states: States) -> F64:
    """(n,) of each reading."""
    return warmth(history, states) if isinstance(history, Use) else wound(history, states)


def wound(winding: Winding, states: States) -> F64:
    """How far the joint is wound up, of what it can be, −1 to 1 (n,); 0 where a session begins."""
    q = states.q[:, winding.joint - 1]
    found = np.zeros(states.n)
    for rows in _runs(states):
        state = 0.0
        for row, way in zip(rows[1:], np.diff(q[rows]) / winding.within_rad, strict=True):
            state = min(max(state + way, -1.0), 1.0)
            found[row] = state
    return found


def warmth(use: Use, states: States) -> F64:
    """The steady rate that would keep the joint so warm, rad/s (n,); 0 where a session begins.

    Between two readings the work is even, so that each interval is solved exactly.
    """
    q, rate = states.q[:, use.joint - 1], np.nan_to_num(states.rate[:, use.joint - 1])
    found = np.zeros(states.n)
    for rows in _runs(states):
        apart_s = np.diff(states.time_s[rows])
        way = np.abs(np.diff(q[rows])) / np.maximum(apart_s, 1e-3)
        work = np.abs(rate[rows[1:]]) if use.by_rate else way
        left = np.exp(-apart_s / use.time_constant_s)
        warm = 0.0
        for row, kept, more in zip(rows[1:], left, work, strict=True):
            warm = kept * warm + (1.0 - kept) * more
            found[row] = warm
    return found


def _runs(states: States) -> Iterator[I64]:
    """Rows of each session, as they follow each other."""
    for run in np.unique(states.series):
        rows = np.flatnonzero(states.series == run)
        yield rows[np.argsort(states.time_s[rows], kind="stable")]

"""How warm a joint is of its own use, at each reading: what `Use` says, from rates or ways."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.effects.effect import Use
from armd.compensation.model.state import States


def warmth(use: Use, states: States) -> F64:
    """The steady rate that would keep the joint so warm, rad/s (n,); 0 where a session begins.

    Between two readings the work is even, so that each interval is solved exactly.
    """
    q, rate = states.q[:, use.joint - 1], np.nan_to_num(states.rate[:, use.joint - 1])
    found = np.zeros(states.n)
    for run in np.unique(states.series):
        rows = np.flatnonzero(states.series == run)
        rows = rows[np.argsort(states.time_s[rows], kind="stable")]
        apart_s = np.diff(states.time_s[rows])
        way = np.abs(np.diff(q[rows])) / np.maximum(apart_s, 1e-3)
        work = np.abs(rate[rows[1:]]) if use.by_rate else way
        left = np.exp(-apart_s / use.time_constant_s)
        warm = 0.0
        for row, kept, more in zip(rows[1:], left, work, strict=True):
            warm = kept * warm + (1.0 - kept) * more
            found[row] = warm
    return found

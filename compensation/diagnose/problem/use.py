"""What went before each reading: how warm a joint is of its use, from rates or ways, and how far it
is wound up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import LEAST_APART_S
from armd.compensation.effects.effect import Use, Winding
from armd.compensation.model.state import States


def evaluated(histories: Sequence[Use | Winding], states: States) -> F64:
    """(H, n) of each history at each reading. All walk through a session side by side: there are
    hundreds of them, and a step costs as much as many numbers."""
    windings = {i: each for i, each in enumerate(histories) if isinstance(each, Winding)}
    uses = {i: each for i, each in enumerate(histories) if isinstance(each, Use)}
    found = np.zeros((len(histories), states.n))
    for rows in _runs(states):
        if windings:
            found[[*windings], rows[:, None]] = _wound([*windings.values()], states, rows)
        if uses:
            found[[*uses], rows[:, None]] = _warmth([*uses.values()], states, rows)
    return found


def _wound(windings: Sequence[Winding], states: States, rows: I64) -> F64:
    """How far each joint is wound up at each of a session's *rows*, of what it can be, −1 to 1
    (rows, windings); 0 where the session begins."""
    q = states.q[rows][:, [winding.joint - 1 for winding in windings]]
    ways = np.diff(q, axis=0) / [winding.within_rad for winding in windings]
    found = np.zeros(q.shape)
    for before, way, now in zip(found, ways, found[1:], strict=False):
        np.add(before, way, out=now)
        np.minimum(np.maximum(now, -1.0, out=now), 1.0, out=now)
    return found


def _warmth(uses: Sequence[Use], states: States, rows: I64) -> F64:
    """The steady rate that would keep each joint so warm at each of a session's *rows*, rad/s
    (rows, uses); 0 where the session begins.

    Between two readings the work is even, so that each interval is solved exactly.
    """
    joints = [use.joint - 1 for use in uses]
    q, rate = states.q[rows][:, joints], np.nan_to_num(states.rate[rows][:, joints])
    apart_s = np.diff(states.time_s[rows])[:, None]
    way = np.abs(np.diff(q, axis=0)) / np.maximum(apart_s, LEAST_APART_S)
    work = np.where([use.by_rate for use in uses], np.abs(rate[1:]), way)
    left = np.exp(-apart_s / [use.time_constant_s for use in uses])
    found = np.zeros(q.shape)
    for before, kept, more, now in zip(found, left, work, found[1:], strict=False):
        np.add(kept * before, (1.0 - kept) * more, out=now)
    return found


def _runs(states: States) -> Iterator[I64]:
    """Rows of each session, as they follow each other."""
    for run in np.unique(states.series):
        rows = np.flatnonzero(states.series == run)
        yield rows[np.argsort(states.time_s[rows], kind="stable")]

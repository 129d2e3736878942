"""What went before each reading: how warm a joint is of its use, from rates or ways, and how far it
is wound up."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import LEAST_APART_S
from armd.compensation.effects.effect import Use, Winding
from armd.compensation.model.state import States


def evaluate_histories(histories: Sequence[Use | Winding], states: States) -> F64:
    """(H, n) of each history at each reading. All walk through a session side by side: there are
    hundreds of them, and a step costs as much as many numbers."""
    windings = {i: history for i, history in enumerate(histories) if isinstance(history, Winding)}
    uses = {i: history for i, history in enumerate(histories) if isinstance(history, Use)}
    values = np.zeros((len(histories), states.n))
    for rows in _runs(states):
        if windings:
            values[[*windings], rows[:, None]] = _wound([*windings.values()], states, rows)
        if uses:
            values[[*uses], rows[:, None]] = _warmth([*uses.values()], states, rows)
    return values


def _wound(windings: Sequence[Winding], states: States, rows: I64) -> F64:
    """How far each joint is wound up at each of a session's *rows*, of what it can be, −1 to 1
    (rows, windings); 0 where the session begins."""
    q = states.q[rows][:, [winding.joint - 1 for winding in windings]]
    turns = np.diff(q, axis=0) / [winding.within_rad for winding in windings]
    wound = np.zeros(q.shape)
    for before, turn, now in zip(wound, turns, wound[1:], strict=False):
        np.add(before, turn, out=now)
        np.minimum(np.maximum(now, -1.0, out=now), 1.0, out=now)
    return wound


def _warmth(uses: Sequence[Use], states: States, rows: I64) -> F64:
    """The steady rate that would keep each joint so warm at each of a session's *rows*, rad/s
    (rows, uses); 0 where the session begins.

    Between two readings the work is even, so that each interval is solved exactly.
    """
    joints = [use.joint - 1 for use in uses]
    q, rate = states.q[rows][:, joints], np.nan_to_num(states.rate[rows][:, joints])
    apart_s = np.diff(states.time_s[rows])[:, None]
    speed = np.abs(np.diff(q, axis=0)) / np.maximum(apart_s, LEAST_APART_S)
    work = np.where([use.by_rate for use in uses], np.abs(rate[1:]), speed)
    decay = np.exp(-apart_s / [use.time_constant_s for use in uses])
    warmth = np.zeros(q.shape)
    for before, factor, steady, now in zip(warmth, decay, work, warmth[1:], strict=False):
        np.add(factor * before, (1.0 - factor) * steady, out=now)
    return warmth


def _runs(states: States) -> Iterator[I64]:
    """Rows of each session, as they follow each other."""
    for run in np.unique(states.series):
        rows = np.flatnonzero(states.series == run)
        yield rows[np.argsort(states.time_s[rows], kind="stable")]

"""The history before each reading: warming by a joint's use, and winding.

Use is measured by rates, or by the ways between readings.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import LEAST_APART_S
from armd.compensation.effects.effect import Use, Winding
from armd.compensation.model.state import States


def evaluate_histories(histories: Sequence[Use | Winding], states: States) -> F64:
    """Evaluate each history at each reading (H, n).

    All histories go through a session side by side: there are hundreds of them, and one step in
    Python costs as much as many numbers.
    """
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
    """Return each joint's winding (rows, windings) at a session's *rows*, −1 to 1.

    It is a share of the largest possible winding, and 0 where the session begins.
    """
    q = states.q[rows][:, [winding.joint - 1 for winding in windings]]
    turns = np.diff(q, axis=0) / [winding.within_rad for winding in windings]
    wound = np.zeros(q.shape)
    for before, turn, now in zip(wound, turns, wound[1:], strict=False):
        np.add(before, turn, out=now)
        np.minimum(np.maximum(now, -1.0, out=now), 1.0, out=now)
    return wound


def _warmth(uses: Sequence[Use], states: States, rows: I64) -> F64:
    """Return the steady rate (rows, uses), rad/s, that would keep each joint as warm as it is.

    It is evaluated at each of a session's *rows*, and is 0 where the session begins. Between two
    readings the work is taken as even, so that each interval is solved exactly.
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
    """Iterate over the sessions, yielding the rows of each in order of time."""
    for run in np.unique(states.series):
        rows = np.flatnonzero(states.series == run)
        yield rows[np.argsort(states.time_s[rows], kind="stable")]

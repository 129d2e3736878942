"""Finds an encoder's turn: the one inside the joint's limits, like the daemon.

After a power cycle an encoder may count a whole turn off. Logs of 0 to 360° differ from arm.toml's
range by a turn half of the time. The geometry does not depend on it, but an error that grows with
the angle does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.data.tables.within import is_within
from armd.compensation.model.arm import Arm

#: At this distance from a limit, rounding may decide the turn.
AT_A_LIMIT_RAD = 1e-6


def find_whole_turns(q: F64, arm: Arm) -> I64:
    """Return the whole turns (n, N) by which angles (n, N) rad are outside their joints' limits.

    Limits at most a turn apart always decide. Wider ones decide where the angle is outside and
    exactly one number of turns leads inside; one limit alone, or none, never does. NaN is 0 turns
    off.
    """
    low, high = arm.limits_rad
    turns = np.zeros_like(q, dtype=np.int64)
    for k, (low_rad, high_rad) in enumerate(zip(low, high, strict=True)):
        if not (math.isfinite(low_rad) and math.isfinite(high_rad)):
            continue
        if _leaves_no_doubt(q[:, k], low_rad, high_rad):
            continue
        if high_rad - low_rad <= math.tau * (1 + 1e-9):
            off = np.floor((q[:, k] - (low_rad + high_rad) / 2) / math.tau + 0.5)
        else:
            fewest = np.ceil((q[:, k] - high_rad) / math.tau)  # turns back: at least …
            largest = np.floor((q[:, k] - low_rad) / math.tau)  # … and at most
            outside = (q[:, k] < low_rad) | (q[:, k] > high_rad)
            off = np.where(outside & (fewest == largest), fewest, 0.0)
        turns[:, k] = np.nan_to_num(off)
    return turns


def are_within_limits(q: F64, arm: Arm) -> bool:
    """Return whether no angle of (n, N) rad can be a turn off, if limits decide that.

    This is much faster than `find_whole_turns`.
    """
    low, high = arm.limits_rad
    return all(
        not (math.isfinite(low_rad) and math.isfinite(high_rad))
        or _leaves_no_doubt(column, low_rad, high_rad)
        for column, low_rad, high_rad in zip(q.T, low, high, strict=True)
    )


def _leaves_no_doubt(q: F64, low_rad: float, high_rad: float) -> bool:
    """Return whether none of *q* (n,) rad is a turn off.

    That is so within the limits or, if these are at most a turn apart, within half a turn from
    their middle.
    """
    beyond = max(math.pi - (high_rad - low_rad) / 2, 0.0)
    return is_within(q, low_rad - beyond + AT_A_LIMIT_RAD, high_rad + beyond - AT_A_LIMIT_RAD)


def are_decided(arm: Arm) -> Mask:
    """Return for which joints (N,) the limits decide the turn at any angle."""
    low, high = arm.limits_rad
    decided: Mask = high - low <= math.tau * (1 + 1e-9)
    return decided


def fold_turns(q: F64, arm: Arm) -> tuple[F64, I64]:
    """Return angles (n, N) rad within the limits that decide the turn, and the turns subtracted."""
    turns = find_whole_turns(q, arm)
    if not turns.any():
        return q, turns
    return np.where(turns == 0, q, q - math.tau * turns), turns


def describe_turns(name: str, turns: I64) -> list[str]:
    """Return a sentence for each joint of session *name* that was whole turns off in some rows."""
    if not turns.any():
        return []
    return [
        f"{name}: q{k + 1} is a whole turn or more off in {int(rows)} of {len(turns)} rows; its"
        " limits in arm.toml say which turn is meant."
        for k, rows in enumerate((turns != 0).sum(axis=0))
        if rows
    ]


@dataclass(frozen=True)
class AngleRange:
    """The range of the joints in one session (N,) rad, and the middle reading of each."""

    name: str
    low: F64
    high: F64
    middle: F64

    @classmethod
    def from_angles(cls, name: str, q: F64) -> AngleRange:
        """Return the range of angles (n, N) rad, n > 0."""
        return cls(name, q.min(axis=0), q.max(axis=0), np.median(q, axis=0))

    def widened(self, q: F64) -> AngleRange:
        """Return the range widened by the session's next angles (n, N) rad, n > 0; the middle
        stays.
        """
        low, high = np.minimum(self.low, q.min(axis=0)), np.maximum(self.high, q.max(axis=0))
        return AngleRange(self.name, low, high, self.middle)


def report_open_turns(ranges: Sequence[AngleRange], arm: Arm) -> list[list[str]]:
    """Return for each session sentences on joints that may be a turn off, because no limit decides
    it.

    That is so if all sessions together turn a joint by more than a turn, and a session lies at
    least half a turn from the middle one, or the joint has no limits.
    """
    remarks: list[list[str]] = [[] for _ in ranges]
    if not ranges:
        return remarks
    lower_rad, upper_rad = arm.limits_rad
    for k in np.flatnonzero(~are_decided(arm)):
        low, high = min(r.low[k] for r in ranges), max(r.high[k] for r in ranges)
        if high - low <= math.tau:
            continue
        usual = float(np.median([r.middle[k] for r in ranges]))
        distant = [i for i, r in enumerate(ranges) if abs(r.middle[k] - usual) >= math.pi]
        if not distant and math.isfinite(upper_rad[k] - lower_rad[k]):
            continue
        for i in distant or [0]:
            r = ranges[i]
            span = (
                f"{math.degrees(r.low[k]):.0f} to {math.degrees(r.high[k]):.0f}°"
                f" (all sessions: {math.degrees(low):.0f} to {math.degrees(high):.0f}°)"
            )
            remarks[i].append(
                f"{r.name}: q{k + 1} stands at {span}, and no limit in arm.toml says which turn is"
                " meant: min_deg and max_deg at most 360° apart would."
            )
    return remarks

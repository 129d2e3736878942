"""Dates of changes, in seconds of Unix time; bad checks do not date a change."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from armd.compensation.interim.changes.change import Change
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.evidence.stack import Stack
from armd.compensation.model.slow_factors import DAY_S


def find_interval(
    checks: Sequence[Reduced], stack: Stack, change: Change, bad: Collection[int]
) -> tuple[float, float]:
    """Return the interval of the change: from the last good check without it to the first with it.

    Both are in seconds of Unix time.
    """
    until = checks[change.latest].first_unix_s
    good = _list_good_before(change.earliest, bad)
    beyond = stack.gap_d * DAY_S
    if not change.gradual:
        return (checks[good[-1]].last_unix_s if good else until - beyond), until
    # A growth is dated to a check, but it may have begun anywhere between that check's neighbours.
    if len(good) > 1:
        return (checks[good[-2]].mean_unix_s + checks[good[-1]].mean_unix_s) / 2, until
    return checks[0].first_unix_s - beyond, until


def find_instant(
    checks: Sequence[Reduced], stack: Stack, change: Change, bad: Collection[int]
) -> float:
    """Return the instant from which the calibration contains a change, in seconds of Unix time.

    A step lies halfway between the last good check without it and the first check with it. A growth
    begins at its origin.
    """
    if change.gradual:
        return checks[0].mean_unix_s + change.origin_d * DAY_S
    first = checks[change.first].first_unix_s
    good = _list_good_before(change.first, bad)
    if not good:
        return first - stack.gap_d * DAY_S / 2
    return (checks[good[-1]].last_unix_s + first) / 2


def _list_good_before(check: int, bad: Collection[int]) -> list[int]:
    return [i for i in range(check) if i not in bad]

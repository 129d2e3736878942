"""A growth dated by a course that may bend: wear goes with use, and use is no straight line.

Beforehand the rate goes at random, as far in two days as in these days one after the other: the
farther bends lie apart, the more a course bends at each, and how many there are changes nothing of
what courses are likely. A long growth has as few as draw it as well as more would, and how much it
bends its checks say (decision 30).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armd.compensation.interim.changes.change import BENDING, Change
from armd.compensation.interim.changes.growing import Growing
from armd.compensation.interim.changes.onset_interval import find_onset_interval
from armd.compensation.interim.evidence.likelihood import LIMIT
from armd.compensation.interim.evidence.stack import Stack

#: Bends lie so many checks apart; in a growth of more than 14 times as many, or 2, 4, … times that.
CHECKS_APART, FEW_BENDS = 3, 14
#: A long growth bends every third check by one of these shares of its rate. With 0.1 the use of a
#: week is taken for another change.
LONG_BENDINGS = (BENDING, 0.4, 0.2)
#: Bends are farther apart where that makes all readings less likely by no more than this (natural
#: logarithm): by less than what a change has to gain to be told.
AS_WELL = 0.6 * LIMIT


def fit_growth(stack: Stack, change: Change, good: Sequence[int], firsts: Sequence[int]) -> Change:
    """A growth at its likeliest onset, one of the checks *firsts*, and the interval of onsets."""
    courses = Growths(stack, good).weigh_onsets(change, firsts)
    low, high = find_onset_interval(np.array([share for share, _ in courses]))
    _, best = max(courses, key=lambda pair: pair[0])
    return replace(best, earliest=firsts[low], latest=firsts[high])


class Growths:
    """Growths of any cause by courses that may bend, weighed by the checks *good* of a stack."""

    def __init__(self, stack: Stack, good: Sequence[int]) -> None:
        self._stack, self._good = stack, good
        self._time = stack.time_d[list(good)]
        self._growing = Growing(stack.select_checks(good))

    def weigh_onsets(self, change: Change, firsts: Sequence[int]) -> list[tuple[float, Change]]:
        """A growth from each of the checks *firsts* on, with its share; all onsets are as likely
        beforehand."""
        assert change.cause is not None
        rate = np.abs(self._growing.rate(change))
        # A rate that differs from column to column bends in its own proportion.
        like = replace(change, rate_size=np.maximum(rate, 0.1 * rate.max()))
        spacing, bending = self._bends(like)
        courses = [self._course(like, first, spacing, bending) for first in firsts]
        plausible = self._growing.log_marginals(change.cause, courses)
        share = np.exp(plausible - plausible.max())
        return list(zip((share / share.sum()).tolist(), courses, strict=True))

    def _bends(self, like: Change) -> tuple[int, float]:
        """How many checks apart a growth's bends have to be, and by what share of its rate it
        bends every third check."""
        assert like.cause is not None
        checks = len(self._good) - self._good.index(like.first)
        aparts = [CHECKS_APART]
        while checks > FEW_BENDS * aparts[-1]:
            aparts.append(2 * aparts[-1])
        if len(aparts) == 1:
            return CHECKS_APART, BENDING
        tried = [(spacing, bending) for spacing in aparts for bending in LONG_BENDINGS]
        courses = [self._course(like, like.first, *choice) for choice in tried]
        plausible = self._growing.log_marginals(like.cause, courses)
        weighed = zip(tried, (plausible - plausible.max()).tolist(), strict=True)
        as_well = [(spacing, log, bending) for (spacing, bending), log in weighed if log > -AS_WELL]
        spacing, _, bending = max(as_well)
        return spacing, bending

    def _course(self, like: Change, first: int, spacing: int, bending: float) -> Change:
        knots = [float(self._time[k]) for k in range(len(self._good) - 2, 0, -spacing)][::-1]
        return replace(
            like,
            first=first,
            origin_d=find_origin_d(self._stack, self._good, self._good.index(first)),
            bends_d=tuple(knot for knot in knots if knot > float(self._stack.time_d[first])),
            bending=bending * float(np.sqrt(spacing / CHECKS_APART)),
        )


def find_origin_d(stack: Stack, good: Sequence[int], first: int) -> float:
    """When a growth that first shows at the kept check *first* begins: at the check before."""
    if first:
        return float(stack.time_d[good[first - 1]])
    return float(stack.time_d[good[0]]) - stack.gap_d

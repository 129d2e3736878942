"""The date of a growth whose rate may vary: wear follows use, and use is not constant.

The prior of the rate is a random walk: its change over two days has the variance of two single
days. So the farther apart the bends are, the more the course may change at each; the number of
bends does not change the prior of the course. A long growth has the fewest bends that describe it
as well as more would. How much it bends is chosen from its checks (decision 30).
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

#: Bends are this many checks apart; in a growth of more than 14 times as many checks they are that
#: distance, or 2, 4, … times it, apart.
CHECKS_APART, FEW_BENDS = 3, 14
#: A long growth changes its rate by one of these shares every third check. With 0.1 the use of one
#: week would be taken for another change.
LONG_BENDINGS = (BENDING, 0.4, 0.2)
#: Bends are set farther apart where this lowers the log likelihood of all readings by no more than
#: this: less than a change must gain to be reported.
AS_WELL = 0.6 * LIMIT


def fit_growth(stack: Stack, change: Change, good: Sequence[int], firsts: Sequence[int]) -> Change:
    """Fit a growth at its likeliest onset, one of the checks *firsts*, with the interval
    of onsets.
    """
    courses = Growths(stack, good).weigh_onsets(change, firsts)
    low, high = find_onset_interval(np.array([share for share, _ in courses]))
    _, best = max(courses, key=lambda pair: pair[0])
    return replace(best, earliest=firsts[low], latest=firsts[high])


class Growths:
    """Growths of any cause with courses that may bend, weighed by the checks *good* of a stack."""

    def __init__(self, stack: Stack, good: Sequence[int]) -> None:
        self._stack, self._good = stack, good
        self._time = stack.time_d[list(good)]
        self._growing = Growing(stack.select_checks(good))

    def weigh_onsets(self, change: Change, firsts: Sequence[int]) -> list[tuple[float, Change]]:
        """Return a growth from each of the checks *firsts*, with its share of the probability.

        All onsets have the same prior probability.
        """
        assert change.cause is not None
        rate = np.abs(self._growing.rate(change))
        # Each column's rate bends in proportion to itself.
        like = replace(change, rate_size=np.maximum(rate, 0.1 * rate.max()))
        spacing, bending = self._bends(like)
        courses = [self._course(like, first, spacing, bending) for first in firsts]
        plausible = self._growing.log_marginals(change.cause, courses)
        share = np.exp(plausible - plausible.max())
        return list(zip((share / share.sum()).tolist(), courses, strict=True))

    def _bends(self, like: Change) -> tuple[int, float]:
        """Choose the distance of a growth's bends in checks, and their share of the rate.

        The share is that by which the rate changes every third check.
        """
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
    """Return when a growth that first shows at the good check number *first* begins: at the check
    before.

    The unit is days since the first check of the stack.
    """
    if first:
        return float(stack.time_d[good[first - 1]])
    return float(stack.time_d[good[0]]) - stack.gap_d

"""A growth dated by a course that may bend: wear goes with use, and use is no straight line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armd.compensation.interim.changes.change import Change
from armd.compensation.interim.changes.growing import Growing
from armd.compensation.interim.changes.held import held
from armd.compensation.interim.evidence.stack import Stack

#: Bends lie so many checks apart, and no more of them than this.
CHECKS_APART, MOST_BENDS = 3, 14


def growth(of: Stack, change: Change, kept: Sequence[int], firsts: Sequence[int]) -> Change:
    """A growth at its likeliest onset, one of the checks *firsts*, and the interval of onsets."""
    found = Growths(of, kept).of(change, firsts)
    low, high = held(np.array([share for share, _ in found]))
    _, best = max(found, key=lambda one: one[0])
    return replace(best, earliest=firsts[low], latest=firsts[high])


class Growths:
    """Growths of any cause by courses that may bend, weighed by the checks *kept* of a stack."""

    def __init__(self, of: Stack, kept: Sequence[int]) -> None:
        self._of, self._kept = of, kept
        some = of.only(kept)
        self._growing = Growing(some)
        apart = max(CHECKS_APART, -(-len(kept) // MOST_BENDS))
        self._knots = [float(some.time_d[k]) for k in range(len(kept) - 2, 0, -apart)][::-1]

    def of(self, change: Change, firsts: Sequence[int]) -> list[tuple[float, Change]]:
        """A growth from each of the checks *firsts* on, with its share; all onsets are as likely
        beforehand."""
        assert change.cause is not None
        rate = np.abs(self._growing.rate(change))
        # A rate that differs from column to column bends in its own proportion.
        size = np.maximum(rate, 0.1 * rate.max())
        courses = []
        for first in firsts:
            origin = origin_d(self._of, self._kept, self._kept.index(first))
            bends = tuple(at for at in self._knots if at > float(self._of.time_d[first]))
            course = replace(change, first=first, origin_d=origin, bends_d=bends, rate_size=size)
            courses.append(course)
        plausible = self._growing.log_marginals(change.cause, courses)
        share = np.exp(plausible - plausible.max())
        return list(zip((share / share.sum()).tolist(), courses, strict=True))


def origin_d(of: Stack, kept: Sequence[int], first: int) -> float:
    """When a growth that first shows at the kept check *first* begins: at the check before."""
    if first:
        return float(of.time_d[kept[first - 1]])
    return float(of.time_d[kept[0]]) - of.gap_d

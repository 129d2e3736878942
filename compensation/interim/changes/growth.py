"""A growth dated by a course that may bend: wear goes with use, and use is no straight line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armd.arrays import F64
from armd.compensation.interim.changes.change import Change, ramp, with_changes
from armd.compensation.interim.changes.held import held
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.likelihood import log_marginal
from armd.compensation.interim.evidence.stack import Stack, Sums

#: Bends lie so many checks apart, and no more of them than this.
CHECKS_APART, MOST_BENDS = 3, 14


def growth(
    of: Stack, causes: Sequence[Cause], change: Change, kept: Sequence[int], firsts: Sequence[int]
) -> Change:
    """A growth at its likeliest onset, one of the checks *firsts*, and the interval of onsets."""
    found = growths(of, causes, change, kept, firsts)
    low, high = held(np.array([share for share, _ in found]))
    _, best = max(found, key=lambda one: one[0])
    return replace(best, earliest=firsts[low], latest=firsts[high])


def growths(
    of: Stack, causes: Sequence[Cause], change: Change, kept: Sequence[int], firsts: Sequence[int]
) -> list[tuple[float, Change]]:
    """A growth from each of the checks *firsts* on by a course that may bend, with its share; all
    onsets are as likely beforehand."""
    assert change.cause is not None
    some = of.only(kept)
    rate = _rate(some, replace(change, first=kept.index(change.first)))
    # A rate that differs from column to column bends in its own proportion.
    size = np.maximum(np.abs(rate), 0.1 * np.abs(rate).max())
    apart = max(CHECKS_APART, -(-len(kept) // MOST_BENDS))
    knots = [float(some.time_d[k]) for k in range(len(kept) - 2, 0, -apart)][::-1]
    courses = []
    for first in firsts:
        origin = origin_d(of, kept, kept.index(first))
        bends = tuple(at for at in knots if at > float(of.time_d[first]))
        courses.append(replace(change, first=first, origin_d=origin, bends_d=bends, rate_size=size))
    plausible = np.array([_marginal(with_changes(some, causes, [course])) for course in courses])
    share = np.exp(plausible - plausible.max())
    return list(zip((share / share.sum()).tolist(), courses, strict=True))


def _rate(of: Stack, change: Change) -> F64:
    """(p,) of a growth at one rate throughout, in typical sizes; *first* counts in *of*."""
    assert change.cause is not None
    block, sums = of.blocks[change.cause], Sums(of)
    factor, side, _ = sums.without_change(of.n)
    cross, towards, _ = sums.begun(np.array([change.first]), of.n, ramp=True)
    cleared = np.linalg.solve(factor, cross[0][:, block])
    grown = ramp(of, change.origin_d)
    own = [weight * columns[:, block] for weight, columns in zip(grown, of.columns, strict=True)]
    gram = sum((one.T @ one for one in own), np.zeros((block.stop - block.start,) * 2))
    gram = gram - cleared.T @ cleared + np.eye(len(gram)) / change.size**2
    rate: F64 = np.linalg.solve(gram, towards[0][block] - cleared.T @ side)
    return rate


def _marginal(of: Stack) -> float:
    """Log of how likely all readings are, everything known integrated out."""
    return log_marginal(Sums(of), of.n)


def origin_d(of: Stack, kept: Sequence[int], first: int) -> float:
    """When a growth that first shows at the kept check *first* begins: at the check before."""
    if first:
        return float(of.time_d[kept[first - 1]])
    return float(of.time_d[kept[0]]) - of.gap_d

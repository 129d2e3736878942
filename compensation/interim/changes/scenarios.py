"""Scenarios of how an arm may have changed that the checks cannot separate, with their shares."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from armd.arrays import F64
from armd.compensation.interim.changes.change import Change, ChangeScenario
from armd.compensation.interim.changes.growth import Growths, find_origin_d
from armd.compensation.interim.changes.likeliest import weigh_again
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.likelihood import SIZES
from armd.compensation.interim.evidence.stack import Stack

#: The likeliest scenarios are kept until they have this share of the probability together, and at
#: most this many.
KEPT_SHARE, MOST_SCENARIOS = 0.99, 60


def list_scenarios(
    stack: Stack, causes: Sequence[Cause], changes: Sequence[Change], bad: Sequence[int]
) -> list[ChangeScenario]:
    """Return the likeliest scenarios of all *changes*; their shares add up to 1.

    Each change may be of any cause, place, onset, shape and size, with its weight in the readings,
    while the other changes are as reported.
    """
    named = [change for change in changes if change.cause is not None]
    scenarios_so_far: list[ChangeScenario] = [(1.0, ())]
    for index in range(len(named)):
        its = _keep_likeliest(_list_alternatives(stack, causes, changes, index, bad))
        scenarios_so_far = _keep_likeliest(
            (share * weight, (*before, *alternative))
            for share, before in scenarios_so_far
            for weight, alternative in its
        )
    strange = tuple(change for change in changes if change.cause is None)
    return [
        (share, (*changes_of_scenario, *strange)) for share, changes_of_scenario in scenarios_so_far
    ]


def _keep_likeliest(scenarios: Iterator[ChangeScenario]) -> list[ChangeScenario]:
    ordered = sorted(scenarios, key=lambda pair: -pair[0])
    shares = np.array([share for share, _ in ordered])
    until = int(np.searchsorted(np.cumsum(shares), KEPT_SHARE * shares.sum())) + 1
    chosen = ordered[: min(until, MOST_SCENARIOS)]
    total = sum(share for share, _ in chosen)
    return [(share / total, changes) for share, changes in chosen]


def _list_alternatives(
    stack: Stack, causes: Sequence[Cause], changes: Sequence[Change], index: int, bad: Sequence[int]
) -> Iterator[ChangeScenario]:
    """Yield all alternatives of one change: steps by cause, onset and size, growths by cause and
    onset.
    """
    without_it, weighed, good = weigh_again(stack, causes, changes, index, bad)
    share = np.exp(weighed.log_by_size - weighed.log_sum)  # (T, K, 2, S)
    firsts = [good[int(first)] for first in weighed.first]

    def make_change(t: int, k: int, gradual: bool, size: float) -> Change:
        first, origin = firsts[t], find_origin_d(stack, good, int(weighed.first[t]))
        return Change(k, gradual, first, first, first, origin, np.nan, size=size)

    for t, k, s in _iterate_largest(share[:, :, 0]):
        yield float(share[t, k, 0, s]), (make_change(t, k, False, SIZES[s]),)
    by_cause = share[:, :, 1].sum(axis=(0, 2))
    growths = Growths(without_it, good)
    for (k,) in _iterate_largest(by_cause):
        grown = share[:, k, 1]
        t, s = (int(position) for position in np.unravel_index(int(np.argmax(grown)), grown.shape))
        likeliest = make_change(t, k, True, SIZES[s])
        for begun, course in growths.weigh_onsets(likeliest, firsts):
            yield float(by_cause[k]) * begun, (course,)


def _iterate_largest(share: F64) -> Iterator[tuple[int, ...]]:
    """Yield the indices of all shares that are large enough to be kept."""
    smallest = (1 - KEPT_SHARE) / MOST_SCENARIOS
    yield from (tuple(int(i) for i in indices) for indices in np.argwhere(share > smallest))

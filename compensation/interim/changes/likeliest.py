"""The likeliest of all weighed changes: its cause, place, shape and onset."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.compensation.interim.changes.change import Change, add_known_changes
from armd.compensation.interim.changes.growth import find_origin_d, fit_growth
from armd.compensation.interim.changes.onset_interval import find_onset_interval
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.likelihood import Weighed, weigh
from armd.compensation.interim.evidence.stack import RunningSums, Stack

#: Rivals less likely than this are not listed.
LEAST_SHARE = 0.01


def weigh_since(
    stack: Stack, causes: Sequence[Cause], since: int, last: int, until: int, bad: Sequence[int]
) -> tuple[Weighed, list[int]]:
    good = [i for i in range(until) if i not in bad]
    first = np.array([k for k, i in enumerate(good) if since <= i < max(last, since + 1)])
    if not len(first):
        first = np.array([len(good) - 1])
    return weigh(
        RunningSums(stack.select_checks(good), int(first[0])), causes, len(good), first
    ), good


def weigh_again(
    stack: Stack, causes: Sequence[Cause], changes: Sequence[Change], index: int, bad: Sequence[int]
) -> tuple[Stack, Weighed, list[int]]:
    """Weigh again one of the named *changes*, between its neighbours, by all readings.

    Returns the stack in which the other changes are known, and the two results of `weigh_since`.
    """
    named = [change for change in changes if change.cause is not None]
    until = next((change.first for change in changes if change.cause is None), stack.n)
    without_it = add_known_changes(stack, named[:index] + named[index + 1 :])
    start = named[index - 1].first + 1 if index else 0
    end = named[index + 1].first if index + 1 < len(named) else until
    return without_it, *weigh_since(without_it, causes, start, end, until, bad)


def find_likeliest(
    stack: Stack, causes: Sequence[Cause], weighed: Weighed, good: Sequence[int]
) -> Change:
    share = np.exp(weighed.log_weight - weighed.log_sum)  # (T, K, 2)
    places: dict[tuple[str, str], list[int]] = {}
    for number, cause in enumerate(causes):
        places.setdefault(cause.place, []).append(number)
    by_place = {place: float(share[:, ks].sum()) for place, ks in places.items()}
    place = max(by_place, key=lambda candidate: by_place[candidate])
    gradual_share = float(share[:, places[place], 1].sum()) / max(by_place[place], 1e-300)
    shape = int(gradual_share > 0.5)
    share_there = share[:, places[place], shape]
    t, k = (
        int(index) for index in np.unravel_index(int(np.argmax(share_there)), share_there.shape)
    )
    onsets = share[:, :, shape].sum(axis=1)
    low, high = find_onset_interval(onsets / onsets.sum())
    first = good[int(weighed.first[t])]
    rivals = sorted(
        (
            (candidate, p)
            for candidate, p in by_place.items()
            if candidate != place and p >= LEAST_SHARE
        ),
        key=lambda pair: -pair[1],
    )
    change = Change(
        cause=places[place][k],
        gradual=bool(shape),
        first=first,
        earliest=good[int(weighed.first[low])],
        latest=good[int(weighed.first[high])],
        origin_d=find_origin_d(stack, good, int(weighed.first[t])),
        probability=by_place[place],
        rivals=tuple(
            (max(places[candidate], key=lambda j: float(share[:, j].sum())), p)
            for candidate, p in rivals
        ),
        gradual_probability=gradual_share,
    )
    if not change.gradual:
        return change
    return fit_growth(stack, change, good, [good[int(first)] for first in weighed.first])

"""The likeliest change of all that were weighed: cause, place, shape, and when it began."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.compensation.interim.changes.change import Change, with_changes
from armd.compensation.interim.changes.growth import growth, origin_d
from armd.compensation.interim.changes.held import held
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.likelihood import Weighed, weigh
from armd.compensation.interim.evidence.stack import RunningSums, Stack

#: Rivals less likely than this are not worth a line.
LEAST_SHARE = 0.01


def weighed_since(
    of: Stack, causes: Sequence[Cause], since: int, last: int, until: int, bad: Sequence[int]
) -> tuple[Weighed, list[int]]:
    kept = [i for i in range(until) if i not in bad]
    first = np.array([k for k, i in enumerate(kept) if since <= i < max(last, since + 1)])
    if not len(first):
        first = np.array([len(kept) - 1])
    return weigh(RunningSums(of.only(kept), int(first[0])), causes, len(kept), first), kept


def weighed_again(
    of: Stack, causes: Sequence[Cause], changes: Sequence[Change], index: int, bad: Sequence[int]
) -> tuple[Stack, Weighed, list[int]]:
    """What one of the named *changes* may be, between its neighbours, by all readings: the stack
    that knows the others, and as `weighed_since` has it."""
    named = [change for change in changes if change.cause is not None]
    until = next((change.first for change in changes if change.cause is None), of.n)
    others = with_changes(of, named[:index] + named[index + 1 :])
    start = named[index - 1].first + 1 if index else 0
    end = named[index + 1].first if index + 1 < len(named) else until
    return others, *weighed_since(others, causes, start, end, until, bad)


def likeliest(of: Stack, causes: Sequence[Cause], weighed: Weighed, kept: Sequence[int]) -> Change:
    share = np.exp(weighed.log_weight - weighed.log_sum)  # (T, K, 2)
    places: dict[tuple[str, str], list[int]] = {}
    for number, cause in enumerate(causes):
        places.setdefault(cause.place, []).append(number)
    by_place = {place: float(share[:, ks].sum()) for place, ks in places.items()}
    place = max(by_place, key=lambda at: by_place[at])
    gradual_share = float(share[:, places[place], 1].sum()) / max(by_place[place], 1e-300)
    shape = int(gradual_share > 0.5)
    own = share[:, places[place], shape]
    t, k = (int(at) for at in np.unravel_index(int(np.argmax(own)), own.shape))
    onsets = share[:, :, shape].sum(axis=1)
    low, high = held(onsets / onsets.sum())
    first = kept[int(weighed.first[t])]
    rivals = sorted(
        ((at, p) for at, p in by_place.items() if at != place and p >= LEAST_SHARE),
        key=lambda pair: -pair[1],
    )
    change = Change(
        cause=places[place][k],
        gradual=bool(shape),
        first=first,
        earliest=kept[int(weighed.first[low])],
        latest=kept[int(weighed.first[high])],
        origin_d=origin_d(of, kept, int(weighed.first[t])),
        probability=by_place[place],
        rivals=tuple(
            (max(places[at], key=lambda j: float(share[:, j].sum())), p) for at, p in rivals
        ),
        gradual_probability=gradual_share,
    )
    if not change.gradual:
        return change
    return growth(of, change, kept, [kept[int(first)] for first in weighed.first])

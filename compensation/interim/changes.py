"""From an alarm to changes: when, whether at once or growing, and which cause of the catalogue.

A change that is told joins what is known of all later checks, and the watch goes on after it. At
every further alarm the last change is looked at anew with all readings since: more readings may
name it otherwise, and only what it cannot be is another change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from armd.compensation.interim.columns import Cause
from armd.compensation.interim.evidence import LIMIT, NOISE_WORD, Weighed, weigh
from armd.compensation.interim.stack import RAMP_DAYS, Stack, Sums
from armd.compensation.interim.watch import Watched, watch

F64 = npt.NDArray[np.float64]

#: An alarm is withdrawn when the statistic, over all readings since, has fallen so low (natural
#: logarithm); while nothing changes it stands at about 2.5, and a change that is there only adds.
REFUTED = 0.6 * LIMIT
#: A growth that was told as a step first began at most so many checks from there.
NEAR = 6
#: More changes than this within one epoch are a worn-out arm, not a list.
MOST_CHANGES = 5
#: Rounds of naming again before the search is ended as it stands.
MOST_ROUNDS = 20
#: Share of the onsets' weight that the interval holds.
HELD = 0.95
#: A told change may be of any size, in typical ones.
ANY_SIZE = 100.0
#: A growth may go on faster or slower from a bend on, by this share of its rate; bends lie so many
#: checks apart, and no more of them than this.
BENDING, CHECKS_APART, MOST_BENDS = 0.7, 3, 14
#: How far its first rate may be from the mean one, as a factor.
WIDE = 2.0
#: Rivals less likely than this are not worth a line.
LEAST_SHARE = 0.01


@dataclass(frozen=True)
class Change:
    """A change at its likeliest, and how sure that is; checks count through the whole stack."""

    cause: int | None  # index into the causes; None: nothing in the catalogue fits
    gradual: bool
    first: int  # the first check that has it
    earliest: int  # the 95 % of onsets show first at one of these checks, from
    latest: int  # … to
    origin_d: float  # of a growth: when it begins, days since the first check
    probability: float  # of the cause at its place
    rivals: tuple[tuple[int, float], ...] = ()  # other causes, one for each place
    gradual_probability: float = 0.0
    bends_d: tuple[float, ...] = ()  # of a growth: where it may go on faster or slower
    rate_size: F64 | None = None  # (p,) of a growth: how large its rate is, in typical sizes

    @property
    def key(self) -> tuple[int | None, bool, int]:
        return self.cause, self.gradual, self.first


@dataclass(frozen=True)
class Found:
    """What became of an epoch's checks."""

    statistic: F64  # (n,) the alarm's statistic after each check
    alarm: int | None
    changes: tuple[Change, ...]  # in order of onset
    bad: tuple[int, ...]


def find(of: Stack, causes: Sequence[Cause]) -> Found:
    """All changes of a stack of checks."""
    found: list[Change] = []
    alarms: list[int] = []
    bad: tuple[int, ...] = ()
    first_look: Watched | None = None
    since = 0
    for _ in range(MOST_ROUNDS):
        null = with_changes(of, causes, found)
        looked = watch(null, causes, since, bad)
        first_look = first_look or looked
        bad = tuple(sorted({*(i for i in bad if i < since), *looked.bad}))
        if looked.alarm is None:
            if found and _refuted(of, causes, found, bad):
                # Later checks speak against the last alarm: it was a false one.
                found.pop()
                since = alarms.pop() + 1
                if since < of.n:
                    continue
            break
        until = looked.alarm + 1
        if looked.strange:
            first = looked.alarm - 2 if looked.alarm >= 2 else 0
            found.append(Change(None, False, first, first, looked.alarm, np.nan, 1.0))
            bad = tuple(i for i in bad if i < first)
            break
        weighed, kept = _weighed(null, causes, since, until, until, bad)
        if found:
            again = _renamed(of, causes, found, alarms[-1], until, bad, weighed.log_sum)
            if again is not None:
                found[-1] = again
                since = again.first + 1
                continue
        new = _likeliest(null, causes, weighed, kept)
        if (same := _same_growth(found, causes, new)) is not None:
            # What moves on at one place is one growth, no staircase; it is known up to here.
            begun = replace(
                found[same],
                gradual=True,
                origin_d=_origin_d(of, kept, kept.index(found[same].first)),
            )
            others = with_changes(of, causes, found[:same])
            near = [i for i in kept if abs(i - begun.first) <= NEAR and i <= alarms[same]]
            found[same] = _growth(others, causes, begun, kept, near)
            del found[same + 1 :], alarms[same + 1 :]
            since = until
            continue
        if len(found) == MOST_CHANGES:
            break
        found.append(new)
        alarms.append(looked.alarm)
        since = new.first + 1
    found = _refined(of, causes, found, bad)
    assert first_look is not None
    statistic = _filled(first_look, of, causes, bad)
    return Found(statistic, first_look.alarm, tuple(found), bad)


def _refined(
    of: Stack, causes: Sequence[Cause], found: list[Change], bad: tuple[int, ...]
) -> list[Change]:
    """Every change looked at once more with all readings, the others known; what they leave too
    little of is dropped."""
    named = [change for change in found if change.cause is not None]
    strange = [change for change in found if change.cause is None]
    until = strange[0].first if strange else of.n
    for _ in range(2):
        i = 0
        while i < len(named):
            others = with_changes(of, causes, named[:i] + named[i + 1 :])
            start = named[i - 1].first + 1 if i else 0
            end = named[i + 1].first if i + 1 < len(named) else until
            weighed, kept = _weighed(others, causes, start, end, until, bad)
            if weighed.log_sum < LIMIT and len(named) > 1:
                del named[i]
                continue
            named[i] = _likeliest(others, causes, weighed, kept)
            if _same_growth(named[:i], causes, named[i]) is not None:
                del named[i]  # under this name it is the growth that is there already
                continue
            i += 1
    return [*named, *strange]


def _filled(first_look: Watched, of: Stack, causes: Sequence[Cause], bad: Sequence[int]) -> F64:
    """The statistic of checks after the alarm: still that of what was known before it."""
    statistic = first_look.statistic.copy()
    if first_look.alarm is None:
        return statistic
    kept = [i for i in range(of.n) if i not in bad]
    sums = Sums(of.only(kept))
    for n in range(first_look.alarm + 2, of.n + 1):
        count = int(np.searchsorted(kept, n))
        first = np.arange(int(np.searchsorted(kept, max(0, first_look.alarm - 10))), count)
        if len(first):
            statistic[n - 1] = weigh(sums, causes, count, first).log_sum
    return statistic


def _same_growth(found: Sequence[Change], causes: Sequence[Cause], new: Change) -> int | None:
    """Which change found *new* only goes on with: one of its cause at its place, if either of them
    grows or it would be the third."""

    def place(change: Change) -> tuple[str, str] | None:
        return None if change.cause is None else causes[change.cause].place

    same = [i for i, change in enumerate(found) if place(change) == place(new)]
    if not same:
        return None
    grows = new.gradual or found[same[-1]].gradual
    return same[0] if grows or len(same) > 1 else None


def _refuted(
    of: Stack, causes: Sequence[Cause], found: Sequence[Change], bad: Sequence[int]
) -> bool:
    """Whether all readings until now hardly want the last change found."""
    start = found[-2].first + 1 if len(found) > 1 else 0
    before = with_changes(of, causes, found[:-1])
    return _weighed(before, causes, start, of.n, of.n, bad)[0].log_sum < REFUTED


def _renamed(
    of: Stack,
    causes: Sequence[Cause],
    found: Sequence[Change],
    alarm: int,
    until: int,
    bad: Sequence[int],
    log_another: float,
) -> Change | None:
    """The last change found under another name, if all readings until now want that rather than
    *another* change beside it; it began by the check that told it, *alarm*."""
    before = with_changes(of, causes, found[:-1])
    start = found[-2].first + 1 if len(found) > 1 else 0
    weighed, kept = _weighed(before, causes, start, alarm + 1, until, bad)
    last = found[-1]
    assert last.cause is not None
    place = (weighed.first == kept.index(last.first), last.cause, int(last.gradual))
    as_it_is = float(weighed.log_weight[place][0])
    if weighed.log_sum <= as_it_is + log_another - LIMIT:
        return None
    again = _likeliest(before, causes, weighed, kept)
    return None if again.key == last.key else again


def _weighed(
    of: Stack, causes: Sequence[Cause], since: int, last: int, until: int, bad: Sequence[int]
) -> tuple[Weighed, list[int]]:
    kept = [i for i in range(until) if i not in bad]
    first = np.array([k for k, i in enumerate(kept) if since <= i < max(last, since + 1)])
    if not len(first):
        first = np.array([len(kept) - 1])
    return weigh(Sums(of.only(kept)), causes, len(kept), first), kept


def _likeliest(of: Stack, causes: Sequence[Cause], weighed: Weighed, kept: Sequence[int]) -> Change:
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
    low, high = _held(onsets / onsets.sum())
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
        origin_d=_origin_d(of, kept, int(weighed.first[t])),
        probability=by_place[place],
        rivals=tuple(
            (max(places[at], key=lambda j: float(share[:, j].sum())), p) for at, p in rivals
        ),
        gradual_probability=gradual_share,
    )
    if not change.gradual:
        return change
    return _growth(of, causes, change, kept, [kept[int(first)] for first in weighed.first])


def _held(share: F64) -> tuple[int, int]:
    """The shortest run of onsets that holds `HELD` of the weight."""
    total = np.concatenate([[0.0], np.cumsum(share)])
    runs = [
        (b - a, -(total[b + 1] - total[a]), a, b)
        for a in range(len(share))
        for b in range(a, len(share))
        if total[b + 1] - total[a] >= HELD * total[-1]
    ]
    _, _, a, b = min(runs)
    return a, b


def _origin_d(of: Stack, kept: Sequence[int], first: int) -> float:
    """When a growth that first shows at the kept check *first* begins: at the check before."""
    if first:
        return float(of.time_d[kept[first - 1]])
    gap = float(np.median(np.diff(of.time_d))) if of.n > 1 else 1.0
    return float(of.time_d[kept[0]]) - gap


def _growth(
    of: Stack, causes: Sequence[Cause], change: Change, kept: Sequence[int], firsts: Sequence[int]
) -> Change:
    """A growth dated by a course that may bend, its onset at one of the checks *firsts*: wear goes
    with use, and use is no straight line."""
    assert change.cause is not None
    some = of.only(kept)
    rate = _rate(some, replace(change, first=kept.index(change.first)))
    # A rate that differs from column to column bends in its own proportion.
    size = np.maximum(np.abs(rate), 0.1 * np.abs(rate).max())
    apart = max(CHECKS_APART, -(-len(kept) // MOST_BENDS))
    knots = [float(some.time_d[k]) for k in range(len(kept) - 2, 0, -apart)][::-1]
    courses = []
    for first in firsts:
        origin = _origin_d(of, kept, kept.index(first))
        bends = tuple(at for at in knots if at > float(of.time_d[first]))
        courses.append(replace(change, first=first, origin_d=origin, bends_d=bends, rate_size=size))
    plausible = np.array([log_marginal(with_changes(some, causes, [course])) for course in courses])
    share = np.exp(plausible - plausible.max())
    low, high = _held(share)
    best = courses[int(np.argmax(share))]
    return replace(best, earliest=firsts[low], latest=firsts[high])


def _rate(of: Stack, change: Change) -> F64:
    """(p,) of a growth at one rate throughout, in typical sizes; *first* counts in *of*."""
    assert change.cause is not None
    block, sums = of.blocks[change.cause], Sums(of)
    factor, side, _ = sums.without_change(of.n)
    cross, towards, _ = sums.begun(np.array([change.first]), of.n, ramp=True)
    cleared = np.linalg.solve(factor, cross[0][:, block])
    ramp = _ramp(of, change.origin_d)
    own = [weight * columns[:, block] for weight, columns in zip(ramp, of.columns, strict=True)]
    gram = sum((one.T @ one for one in own), np.zeros((block.stop - block.start,) * 2))
    gram = gram - cleared.T @ cleared + np.eye(len(gram)) / ANY_SIZE**2
    rate: F64 = np.linalg.solve(gram, towards[0][block] - cleared.T @ side)
    return rate


def log_marginal(of: Stack) -> float:
    """Log of how likely all readings are, everything known integrated out; up to a constant."""
    q = of.known[0].shape[1]
    curvature, side, left, freedom = np.eye(q), np.zeros(q), NOISE_WORD, NOISE_WORD
    for known, residual in zip(of.known, of.residual, strict=True):
        curvature += known.T @ known
        side += known.T @ residual
        left += float(residual @ residual)
        freedom += len(residual)
    factor = np.linalg.cholesky(curvature)
    towards = np.linalg.solve(factor, side)
    spread = float(np.log(np.diag(factor)).sum())
    return -spread - 0.5 * freedom * float(np.log(left - towards @ towards))


def _ramp(of: Stack, origin_d: float) -> F64:
    ramp: F64 = np.maximum(of.time_d - origin_d, 0.0) / RAMP_DAYS
    return ramp


def shapes(of: Stack, change: Change) -> F64:
    """(n, 1 + bends) how far a change is at each check, per amplitude of each of its columns."""
    if not change.gradual:
        return (np.arange(of.n) >= change.first).astype(float)[:, None]
    return np.stack([_ramp(of, at) for at in (change.origin_d, *change.bends_d)], axis=1)


def amplitude_sizes(change: Change, columns: int) -> F64:
    """(1 + bends, p) prior standard deviations of a change's amplitudes, in typical sizes."""
    if change.rate_size is None:
        return np.full((1, columns), ANY_SIZE)
    sizes = np.tile(BENDING * change.rate_size, (1 + len(change.bends_d), 1))
    sizes[0] = WIDE * change.rate_size
    return sizes


def with_changes(of: Stack, causes: Sequence[Cause], changes: Sequence[Change]) -> Stack:
    """The stack where these changes, of whatever size, are among what is known."""
    columns: list[list[F64]] = [[] for _ in range(of.n)]
    for change in changes:
        if change.cause is None:
            continue
        block = of.blocks[change.cause]
        shape = shapes(of, change)
        sizes = amplitude_sizes(change, block.stop - block.start)
        for i in range(of.n):
            own = of.columns[i][:, block]
            wide = (shape[i][:, None, None] * sizes[:, None, :] * own[None]).transpose(1, 0, 2)
            columns[i].append(wide.reshape(len(own), -1))
    if not any(columns):
        return of
    return of.knowing([np.concatenate(own, axis=1) for own in columns])

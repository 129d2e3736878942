"""From an alarm to changes: when, whether at once or growing, and which cause of the catalogue.

A change that is told joins what is known of all later checks, and the watch goes on after it. At
every further alarm the last change is looked at anew with all readings since: more readings may
name it otherwise, and only what it cannot be is another change. Where that leads back to what was
looked at before, the search ends with the best of what it goes round between (decision 30): there
are finitely many, so it always ends.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armd.arrays import F64
from armd.compensation.interim.changes.change import Change, ChangesFound, add_known_changes
from armd.compensation.interim.changes.circle import SearchState, choose_best_stand, find_circle
from armd.compensation.interim.changes.growth import find_origin_d, fit_growth
from armd.compensation.interim.changes.likeliest import find_likeliest, weigh_again, weigh_since
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.likelihood import LIMIT, weigh
from armd.compensation.interim.evidence.looks import NEVER_YET, EpochLook, EpochLooks
from armd.compensation.interim.evidence.stack import RunningSums, Stack
from armd.compensation.interim.evidence.watch import Watched, detect_changes

#: An alarm is withdrawn when the statistic, over all readings since, has fallen so low (natural
#: logarithm); while nothing changes it stands at about 2.5, and a change that is there only adds.
REFUTED = 0.6 * LIMIT
#: A growth that was told as a step first began at most so many checks from there.
NEAR = 6
#: More changes than this within one epoch are a worn-out arm, not a list.
MOST_CHANGES = 5
#: The statistic after the alarm is of changes that began so many checks before it at most.
BEFORE_ALARM = 10


def find(stack: Stack, causes: Sequence[Cause], before: EpochLooks = NEVER_YET) -> ChangesFound:
    """All changes of a stack of checks, some of which may have been watched *before*."""
    changes: list[Change] = []
    alarms: list[int] = []
    bad: tuple[int, ...] = ()
    first_look: Watched | None = None
    stands: list[SearchState] = []
    since = 0
    while True:
        null = add_known_changes(stack, changes)
        known_numbers = tuple(number for change in changes for number in change.numbers)
        left_out = tuple(i for i in bad if i < since)
        if whole_circle := find_circle(stands, since, left_out, known_numbers, alarms):
            stand = choose_best_stand(stack, whole_circle)
            changes, bad = [*stand.changes], stand.bad
            break
        looked = detect_changes(
            null, causes, since, bad, before.find_quiet_run(since, left_out, known_numbers)
        )
        first_look = first_look or looked
        bad = tuple(sorted({*left_out, *looked.bad}))
        look = EpochLook(since, left_out, known_numbers, looked.quiet)
        stands.append(SearchState(look, tuple(changes), tuple(alarms), bad))
        if looked.alarm is None:
            if changes and _weigh_last_change(stack, causes, changes, stack.n, bad) < REFUTED:
                # Later checks speak against the last alarm: it was a false one.
                changes.pop()
                since = alarms.pop() + 1
                if since < stack.n:
                    continue
            break
        until = looked.alarm + 1
        if looked.strange:
            first = looked.alarm - 2 if looked.alarm >= 2 else 0
            changes.append(Change(None, False, first, first, looked.alarm, np.nan, 1.0))
            bad = tuple(i for i in bad if i < first)
            break
        weighed, good = weigh_since(null, causes, since, until, until, bad)
        if changes:
            again = _rename_change(
                stack, causes, changes, alarms[-1], until, bad, weighed.log_alarm
            )
            if again is not None:
                changes[-1] = again
                since = again.first + 1
                continue
            if (
                _weigh_last_change(stack, causes, changes, until, bad) + weighed.log_alarm
                < 2 * LIMIT
            ):
                # There and back is less likely than a false alarm, and what ended it another.
                changes.pop()
                since = alarms.pop() + 1
                continue
        new = find_likeliest(null, causes, weighed, good)
        if (same := _find_same_growth(changes, causes, new)) is not None:
            # What moves on at one place is one growth, no staircase; it is known up to here.
            begun = replace(
                changes[same],
                gradual=True,
                origin_d=find_origin_d(stack, good, good.index(changes[same].first)),
            )
            without_it = add_known_changes(stack, changes[:same])
            neighbours = [i for i in good if abs(i - begun.first) <= NEAR and i <= alarms[same]]
            changes[same] = fit_growth(without_it, begun, good, neighbours)
            del changes[same + 1 :], alarms[same + 1 :]
            since = until
            continue
        if len(changes) == MOST_CHANGES:
            break
        changes.append(new)
        alarms.append(looked.alarm)
        since = new.first + 1
    changes = _refine(stack, causes, changes, bad)
    assert first_look is not None
    statistic = _fill(first_look, stack, causes, bad, before)
    after = () if first_look.alarm is None else statistic[first_look.alarm + 1 : -1].tolist()
    looks = tuple(stand.look for stand in stands)
    remembered = EpochLooks(looks, tuple(after), tuple(i for i in bad if i < stack.n - 1))
    return ChangesFound(statistic, first_look.alarm, tuple(changes), bad, remembered)


def _refine(
    stack: Stack, causes: Sequence[Cause], changes: list[Change], bad: tuple[int, ...]
) -> list[Change]:
    """Every change looked at once more with all readings, the others known; what they leave too
    little of is dropped."""
    named = [change for change in changes if change.cause is not None]
    strange = [change for change in changes if change.cause is None]
    for _ in range(2):
        i = 0
        while i < len(named):
            without_it, weighed, good = weigh_again(stack, causes, [*named, *strange], i, bad)
            if weighed.log_alarm < LIMIT and len(named) > 1:
                del named[i]
                continue
            named[i] = find_likeliest(without_it, causes, weighed, good)
            if _find_same_growth(named[:i], causes, named[i]) is not None:
                del named[i]  # under this name it is the growth that is there already
                continue
            i += 1
    return [*named, *strange]


def _fill(
    first_look: Watched,
    stack: Stack,
    causes: Sequence[Cause],
    bad: Sequence[int],
    before: EpochLooks,
) -> F64:
    """The statistic of checks after the alarm: still that of what was known before it."""
    statistic = first_look.statistic.copy()
    if first_look.alarm is None:
        return statistic
    good = [i for i in range(stack.n) if i not in bad]
    begin = bisect_left(good, max(0, first_look.alarm - BEFORE_ALARM))
    sums = RunningSums(stack.select_checks(good), begin)
    for i in range(first_look.alarm + 1, stack.n):
        count = bisect_left(good, i + 1)
        if (remembered := before.after_alarm(first_look.alarm, i, bad)) is not None:
            statistic[i] = remembered
        elif begin < count:
            statistic[i] = weigh(sums, causes, count, np.arange(begin, count)).log_sum
    return statistic


def _find_same_growth(
    changes: Sequence[Change], causes: Sequence[Cause], new: Change
) -> int | None:
    """Which change found *new* only goes on with: one of its cause at its place, if either of them
    grows or it would be the third."""

    def place(change: Change) -> tuple[str, str] | None:
        return None if change.cause is None else causes[change.cause].place

    same = [i for i, change in enumerate(changes) if place(change) == place(new)]
    if not same:
        return None
    grows = new.gradual or changes[same[-1]].gradual
    return same[0] if grows or len(same) > 1 else None


def _weigh_last_change(
    stack: Stack, causes: Sequence[Cause], changes: Sequence[Change], until: int, bad: Sequence[int]
) -> float:
    """Log ratio of all readings *until* a check with some change where the last one found may be,
    to that without it."""
    start = changes[-2].first + 1 if len(changes) > 1 else 0
    before = add_known_changes(stack, changes[:-1])
    return weigh_since(before, causes, start, until, until, bad)[0].log_alarm


def _rename_change(
    stack: Stack,
    causes: Sequence[Cause],
    changes: Sequence[Change],
    alarm: int,
    until: int,
    bad: Sequence[int],
    log_another: float,
) -> Change | None:
    """The last change found under another name, if all readings until now want that rather than
    *another* change beside it; it began by the check that told it, *alarm*."""
    before = add_known_changes(stack, changes[:-1])
    start = changes[-2].first + 1 if len(changes) > 1 else 0
    weighed, good = weigh_since(before, causes, start, alarm + 1, until, bad)
    last = changes[-1]
    assert last.cause is not None
    place = (weighed.first == good.index(last.first), last.cause, int(last.gradual))
    as_it_is = float(weighed.log_weight[place][0])
    if weighed.log_sum <= as_it_is + log_another - LIMIT:
        return None
    again = find_likeliest(before, causes, weighed, good)
    return None if again.key == last.key else again

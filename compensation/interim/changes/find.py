"""The search for changes after an alarm: when, sudden or gradual, and which cause of the catalogue.

A reported change is a known error of all later checks, and the watch continues after it. At every
further alarm the last change is estimated again with all readings since: they may give it another
cause. Only what the last change cannot explain becomes another change. If the search returns to a
state that it has visited, it ends with the best state of the cycle (decision 30). The number of
states is finite, so the search always ends.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armd.arrays import F64
from armd.compensation.interim.changes.change import Change, ChangesFound, add_known_changes
from armd.compensation.interim.changes.circle import SearchState, choose_best_state, find_cycle
from armd.compensation.interim.changes.growth import find_origin_d, fit_growth
from armd.compensation.interim.changes.likeliest import find_likeliest, weigh_again, weigh_since
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.likelihood import LIMIT, weigh
from armd.compensation.interim.evidence.looks import NEVER_YET, EpochLook, EpochLooks
from armd.compensation.interim.evidence.stack import RunningSums, Stack
from armd.compensation.interim.evidence.watch import Watched, detect_changes

#: An alarm is withdrawn when the statistic over all later readings falls to this (natural
#: logarithm). Without a change the statistic stays at about 2.5; a real change only increases it.
REFUTED = 0.6 * LIMIT
#: A growth that was reported as a step first began at most this many checks from there.
NEAR = 6
#: The most changes that are listed within one epoch; an arm with more of them is worn out.
MOST_CHANGES = 5
#: After the alarm the statistic covers changes that began at most this many checks before it.
BEFORE_ALARM = 10


def find(stack: Stack, causes: Sequence[Cause], before: EpochLooks = NEVER_YET) -> ChangesFound:
    """Find all changes in a stack of checks, some of which may have been watched *before*."""
    changes: list[Change] = []
    alarms: list[int] = []
    bad: tuple[int, ...] = ()
    first_look: Watched | None = None
    states: list[SearchState] = []
    since = 0
    while True:
        null = add_known_changes(stack, changes)
        known_numbers = tuple(number for change in changes for number in change.numbers)
        left_out = tuple(i for i in bad if i < since)
        if cycle := find_cycle(states, since, left_out, known_numbers, alarms):
            state = choose_best_state(stack, cycle)
            changes, bad = [*state.changes], state.bad
            break
        looked = detect_changes(
            null, causes, since, bad, before.find_quiet_run(since, left_out, known_numbers)
        )
        first_look = first_look or looked
        bad = tuple(sorted({*left_out, *looked.bad}))
        look = EpochLook(since, left_out, known_numbers, looked.quiet)
        states.append(SearchState(look, tuple(changes), tuple(alarms), bad))
        if looked.alarm is None:
            if changes and _weigh_last_change(stack, causes, changes, stack.n, bad) < REFUTED:
                # Later checks contradict the last alarm: it was a false one.
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
                # A change and its reversal are less likely than a false alarm followed by another
                # change.
                changes.pop()
                since = alarms.pop() + 1
                continue
        new = find_likeliest(null, causes, weighed, good)
        if (same := _find_same_growth(changes, causes, new)) is not None:
            # Repeated changes at one place are one growth, not several steps; it is known up to
            # here.
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
    looks = tuple(state.look for state in states)
    remembered = EpochLooks(looks, tuple(after), tuple(i for i in bad if i < stack.n - 1))
    return ChangesFound(statistic, first_look.alarm, tuple(changes), bad, remembered)


def _refine(
    stack: Stack, causes: Sequence[Cause], changes: list[Change], bad: tuple[int, ...]
) -> list[Change]:
    """Estimate every change again with all readings, given the others; drop those
    without evidence.
    """
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
                del named[i]  # with this cause it is a growth that is listed already
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
    """Fill in the statistic of checks after the alarm, under what was known before the alarm."""
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
    """Return the index of the change that *new* continues, or None.

    That is the first change of the same cause at the same place, if either of them grows or *new*
    would be the third.
    """

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
    """Return the log likelihood ratio of a change in place of the last one to none.

    All readings *until* a check count; the earlier changes are known.
    """
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
    """Return the last change with another cause, date or shape, if the readings prefer that; else
    None.

    The alternative is a second change beside the last one, of log ratio *log_another*. The last
    change began by check *alarm*, which reported it; all readings *until* now count.
    """
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

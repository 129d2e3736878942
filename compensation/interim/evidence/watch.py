"""The watch of checks in sequence: when a change is reported, and which checks are bad.

Each of the last few checks may be bad. Every combination is weighed, with a change in the others
and without one, so a bad check right before a change hides neither.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import logsumexp

from armd.arrays import F64
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.bad_check import ONE_IN, OtherChecks, find_spoilt
from armd.compensation.interim.evidence.elimination import CheckSums
from armd.compensation.interim.evidence.likelihood import (
    LIMIT,
    MOST_BACK,
    compute_log_marginal,
    weigh,
)
from armd.compensation.interim.evidence.looks import NOTHING_YET, QuietRun
from armd.compensation.interim.evidence.stack import RunningSums, Stack

#: A check may still turn out to be bad until this many later checks are there. This many
#: consecutive checks that no cause of the catalogue explains are an unnamed change.
UNSETTLED = 3
#: The prior probability, at an onset, of a change by a cause that is not in the catalogue.
STRANGE = 0.02


@dataclass(frozen=True)
class Watched:
    """The result of watching checks one after another."""

    statistic: F64  # (n,) after each check, NaN where it was not watched
    alarm: int | None  # the first check after which the statistic exceeded its limit
    strange: bool  # whether no cause of the catalogue explains the reported change
    bad: tuple[int, ...]  # checks that are bad
    quiet: QuietRun  # up to the last watched check, without it


@dataclass(frozen=True)
class WatchResult:
    """The result of all checks until now, of which the last ones may be doubted.

    Checks are numbered as in the sums.
    """

    statistic: float
    strange: bool
    bad: tuple[int, ...]  # those of the doubted, if a change is reported now


def detect_changes(
    stack: Stack,
    causes: Sequence[Cause],
    since: int = 0,
    known_bad: Sequence[int] = (),
    begun: QuietRun = NOTHING_YET,
) -> Watched:
    """Watch checks from *since* on, until a change is reported; *known_bad* are left out.

    Some of the checks may have been watched before, with the result *begun*.
    """
    watched = len(begun.statistic)
    settled = list(begun.bad) if watched else [i for i in known_bad if i < since]
    statistics = np.full(stack.n, np.nan)
    statistics[since : since + watched] = begun.statistic
    doubted: list[int] = []
    sums, good = _make_sums(stack, settled, since + watched)
    quiet = begun
    for n in range(since + watched + 1, stack.n + 1):
        quiet = QuietRun(tuple(statistics[since : n - 1].tolist()), tuple(settled))
        count, begins = (bisect_left(good, check) for check in (n, since))
        unsettled = range(bisect_left(good, max(since, n - UNSETTLED)), count)
        places = (
            list(find_spoilt(sums.stack, sums.sum_first(count), unsettled)) if count > 1 else []
        )
        if places:
            result = _weigh(sums, causes, begins, count, places)
        else:
            result = WatchResult(_compute_log_ratio(sums, causes, begins, count), False, ())
        doubted = [good[i] for i in places]
        statistics[n - 1] = result.statistic
        if result.statistic >= LIMIT:
            bad = tuple(sorted({*settled, *(good[i] for i in result.bad)}))
            return Watched(statistics, n - 1, result.strange, bad, quiet)
        past = [i for i in doubted if i <= n - UNSETTLED]
        if past:
            settled = sorted({*settled, *past})
            sums, good = _make_sums(stack, settled, n)
    return Watched(statistics, None, False, tuple(sorted({*settled, *doubted})), quiet)


def _weigh(
    sums: RunningSums,
    causes: Sequence[Cause],
    begins: int,
    count: int,
    doubted: Sequence[int],
) -> WatchResult:
    """Compute the log odds of a change from check *begins* on, after *count* checks.

    The result is averaged over which of the *doubted* checks are bad.
    """
    stack, every = sums.stack, sums.sum_first(count)
    without_doubted = compute_log_marginal(stack, _drop_checks(stack, every, doubted))
    spoilt_log = {
        i: compute_log_marginal(stack, with_it)
        - without_doubted
        + OtherChecks(stack, with_it).log_evidence(i)
        for i in doubted
        for with_it in [_drop_checks(stack, every, [k for k in doubted if k != i])]
    }
    combinations_of_bad = [
        chosen for k in range(len(doubted) + 1) for chosen in combinations(doubted, k)
    ]
    nothing, change = np.empty((2, len(combinations_of_bad)))
    for w, chosen in enumerate(combinations_of_bad):
        bad = sum(spoilt_log[i] - np.log(ONE_IN) for i in chosen)
        nothing[w] = bad + compute_log_marginal(stack, _drop_checks(stack, every, chosen))
        good, begin = sums.drop_checks(chosen, count, MOST_BACK)
        onsets = max(begins - sum(i < begins for i in chosen) - begin, 0)
        change[w] = nothing[w] + _compute_log_ratio(good, causes, onsets, good.stack.n)
    nameless = -np.inf
    if len(doubted) == UNSETTLED:
        nameless = np.log(STRANGE) + without_doubted + sum(spoilt_log.values())
    strange = bool(nameless > logsumexp(change))
    return WatchResult(
        statistic=float(logsumexp([*change, nameless]) - logsumexp(nothing)),
        strange=strange,
        bad=() if strange else tuple(combinations_of_bad[int(np.argmax(change))]),
    )


def _drop_checks(stack: Stack, sums: CheckSums, left_out: Sequence[int]) -> CheckSums:
    for i in left_out:
        sums = sums.subtract_check(stack.error_columns[i], stack.residual[i])
    return sums


def _make_sums(
    stack: Stack, left_out: Sequence[int], watched: int
) -> tuple[RunningSums, list[int]]:
    """Make the sums over all checks except those *left_out*, and return their numbers.

    The first *watched* checks have been weighed before.
    """
    good = [i for i in range(stack.n) if i not in left_out]
    back = MOST_BACK + UNSETTLED + 1  # some of the last may be left out as well
    begin = max(0, bisect_left(good, watched + 1) - back)
    return RunningSums(stack.select_checks(good), begin), good


def _compute_log_ratio(
    sums: RunningSums, causes: Sequence[Cause], begins: int, count: int
) -> float:
    """Return the log likelihood ratio, summed over changes from check *begins* on, of *count*
    checks.
    """
    first = np.arange(max(begins, count - MOST_BACK), count)
    return weigh(sums, causes, count, first).log_sum if len(first) else -np.inf

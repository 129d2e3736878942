"""Checks watched in sequence: when a change is told, and which checks were bad themselves.

The last few checks may each be bad. Every way of that is weighed, with a change in the others and
without one: a bad check right before a change hides neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import logsumexp

from armd.arrays import F64
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.bad_check import ONE_IN, Rest, spoilt
from armd.compensation.interim.evidence.likelihood import LIMIT, MOST_BACK, log_marginal, weigh
from armd.compensation.interim.evidence.stack import RunningSums, Stack

#: Until so many later checks are there, a check may turn out to have been bad; so many in a row
#: that no cause of the catalogue explains are a change without a name.
UNSETTLED = 3
#: A change that nothing in the catalogue makes is so likely, at an onset.
STRANGE = 0.02


@dataclass(frozen=True)
class Watched:
    """What came of watching checks one after another."""

    statistic: F64  # (n,) after each check, NaN where it was not watched
    alarm: int | None  # the first check after which the statistic exceeded its limit
    strange: bool  # whether what was told then fits nothing in the catalogue
    bad: tuple[int, ...]  # checks that are off by themselves


@dataclass(frozen=True)
class Standing:
    """What all checks until now say, some of the last of them doubted."""

    statistic: float
    strange: bool
    bad: tuple[int, ...]  # of the doubted, if a change is told now


def watch(
    of: Stack, causes: Sequence[Cause], since: int = 0, known_bad: Sequence[int] = ()
) -> Watched:
    """Watch checks from *since* on, until a change is told; *known_bad* are left out."""
    settled = [i for i in known_bad if i < since]
    statistics = np.full(of.n, np.nan)
    doubted: list[int] = []
    sums, kept = _sums(of, settled)
    for n in range(since + 1, of.n + 1):
        here = [i for i in range(n) if i not in settled]
        open_ = [i for i in here if i >= max(since, n - UNSETTLED)]
        doubted = list(spoilt(of, here, open_)) if len(here) > 1 else []
        if doubted:
            standing = _weighed(of, causes, since, here, doubted)
        else:
            standing = Standing(_statistic(sums, kept, causes, since, n), False, ())
        statistics[n - 1] = standing.statistic
        if standing.statistic >= LIMIT:
            bad = tuple(sorted({*settled, *standing.bad}))
            return Watched(statistics, n - 1, standing.strange, bad)
        past = [i for i in doubted if i <= n - UNSETTLED]
        if past:
            settled = sorted({*settled, *past})
            sums, kept = _sums(of, settled)
    return Watched(statistics, None, False, tuple(sorted({*settled, *doubted})))


def _weighed(
    of: Stack, causes: Sequence[Cause], since: int, here: Sequence[int], doubted: Sequence[int]
) -> Standing:
    """Log odds of a change after the checks *here*, whichever of the *doubted* are bad."""
    clean = [i for i in here if i not in doubted]
    rest = _marginal(of, clean)
    alone = {
        i: _marginal(of, with_it) - rest + Rest(of, with_it).log_evidence(i)
        for i in doubted
        for with_it in [sorted([*clean, i])]
    }
    ways = [way for k in range(len(doubted) + 1) for way in combinations(doubted, k)]
    nothing, change = np.empty((2, len(ways)))
    for w, way in enumerate(ways):
        sums, kept = _sums(of.only(here), [here.index(i) for i in way])
        bad = sum(alone[i] - np.log(ONE_IN) for i in way)
        nothing[w] = bad + log_marginal(sums, len(kept))
        begins = sum(here[k] < since for k in kept)
        change[w] = nothing[w] + _log_ratio(sums, causes, begins, len(kept))
    nameless = -np.inf
    if len(doubted) == UNSETTLED:
        nameless = np.log(STRANGE) + rest + sum(alone.values())
    strange = bool(nameless > logsumexp(change))
    return Standing(
        statistic=float(logsumexp([*change, nameless]) - logsumexp(nothing)),
        strange=strange,
        bad=() if strange else tuple(ways[int(np.argmax(change))]),
    )


def _marginal(of: Stack, checks: Sequence[int]) -> float:
    return log_marginal(RunningSums(of.only(checks)), len(checks)) if len(checks) else 0.0


def _sums(of: Stack, left_out: Sequence[int]) -> tuple[RunningSums, list[int]]:
    kept = [i for i in range(of.n) if i not in left_out]
    return RunningSums(of.only(kept)), kept


def _statistic(
    sums: RunningSums, kept: Sequence[int], causes: Sequence[Cause], since: int, n: int
) -> float:
    """The alarm's statistic after *n* checks, of those kept."""
    count, begins = (int(np.searchsorted(kept, at)) for at in (n, since))
    return _log_ratio(sums, causes, begins, count)


def _log_ratio(sums: RunningSums, causes: Sequence[Cause], begins: int, count: int) -> float:
    """Log of the summed ratio, of *count* checks, for changes from check *begins* on."""
    first = np.arange(max(begins, count - MOST_BACK), count)
    return weigh(sums, causes, count, first).log_sum if len(first) else -np.inf

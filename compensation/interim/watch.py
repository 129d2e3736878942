"""Checks watched in sequence: when a change is told, and which checks were bad themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.compensation.interim.bad_check import spoilt
from armd.compensation.interim.columns import Cause
from armd.compensation.interim.evidence import LIMIT, MOST_BACK, weigh
from armd.compensation.interim.stack import Stack, Sums

F64 = npt.NDArray[np.float64]

#: Until so many later checks are there, a check may turn out to have been bad.
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


def watch(
    of: Stack, causes: Sequence[Cause], since: int = 0, known_bad: Sequence[int] = ()
) -> Watched:
    """Watch checks from *since* on, until a change is told; *known_bad* are left out."""
    settled = [i for i in known_bad if i < since]
    statistics = np.full(of.n, np.nan)
    strange = -np.inf  # log of the running ratio of a change without a name
    doubted: dict[int, float] = {}
    sums, kept = _sums(of, settled)
    for n in range(since + 1, of.n + 1):
        if len(settled) + len(kept) < n - 1:
            raise AssertionError("a check was lost")
        here = [i for i in range(n) if i not in settled]
        open_ = [i for i in here if i >= max(since, n - UNSETTLED)]
        doubted = spoilt(of, here, open_) if len(here) > 1 else {}
        everything = _statistic(sums, kept, causes, since, n)
        off = doubted.get(n - 1, -np.inf)
        strange = np.logaddexp(0.0, strange) + off + np.log(50.0) if off > 0 else -np.inf
        if doubted:
            odds = sum(doubted.values())
            without = _sums(of, [*settled, *doubted])
            clean = _statistic(*without, causes, since, n)
            nameless = np.log(STRANGE) + strange
            said = np.logaddexp(np.logaddexp(everything, nameless), odds + clean)
            statistics[n - 1] = said - np.logaddexp(0.0, odds)
            if statistics[n - 1] >= LIMIT:
                spoilt_too = odds + clean > everything
                bad = sorted({*settled, *doubted}) if spoilt_too else settled
                return Watched(statistics, n - 1, nameless > everything, tuple(bad))
        else:
            statistics[n - 1] = everything
            if everything >= LIMIT:
                return Watched(statistics, n - 1, False, tuple(settled))
        past = [i for i in doubted if i <= n - UNSETTLED]
        if past:
            settled = sorted({*settled, *past})
            sums, kept = _sums(of, settled)
    return Watched(statistics, None, False, tuple(sorted({*settled, *doubted})))


def _sums(of: Stack, left_out: Sequence[int]) -> tuple[Sums, list[int]]:
    kept = [i for i in range(of.n) if i not in left_out]
    return Sums(of.only(kept)), kept


def _statistic(
    sums: Sums, kept: Sequence[int], causes: Sequence[Cause], since: int, n: int
) -> float:
    """The alarm's statistic after *n* checks, of those kept."""
    count = int(np.searchsorted(kept, n))
    first = np.arange(max(int(np.searchsorted(kept, since)), count - MOST_BACK), count)
    if not len(first):
        return -np.inf
    return weigh(sums, causes, count, first).log_sum

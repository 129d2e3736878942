"""The search for changes in the figures of an arm: check by check, each alarm with later checks."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.special import logsumexp

from armd.arrays import F64
from armd.compensation.interim.points.evidence import (
    GRADUAL_SHARE,
    LIMIT,
    RATES_PER_DAY,
    STEPS,
    ChangeCourse,
    Series,
    compute_log_ratios,
)

#: The number of later checks that are used to explain an alarm.
LATER_CHECKS = 5
#: The assumed frequency of changes and of bad checks, per check.
CHANGE_SHARE, BAD_SHARE = 1 / 100, 1 / 50
#: The probability that a change lies outside its interval.
OUTSIDE = 0.05


@dataclass(frozen=True)
class PointChange:
    """A change and its probability."""

    course: ChangeCourse
    earliest: int  # 95 % interval of the first check that has it: from
    latest: int  # … to
    probability: float  # of a change, rather than chance or a bad check


@dataclass
class PointChanges:
    """The changes and bad checks of a series."""

    statistic: F64  # (n,) natural logarithm
    changes: list[PointChange] = field(default_factory=list)
    bad: list[int] = field(default_factory=list)

    @property
    def courses(self) -> list[ChangeCourse]:
        return [change.course for change in self.changes]


def find_changes(series: Series) -> PointChanges:
    """Find changes and bad checks, check by check in order of time."""
    detected = PointChanges(np.full(series.n, -np.inf))
    row = 0
    while row < series.n:
        detected.statistic[row] = _compute_statistic(series, detected, row)
        if row not in detected.bad and detected.statistic[row] >= LIMIT:
            bad, change = _explain(series, detected, row)
            if change is None:
                detected.bad.append(bad)
                row = bad  # watch the later checks again, without it
            else:
                detected.changes.append(change)
        row += 1
    detected.bad.sort()
    return detected


def _list_starts(detected: PointChanges, last: int) -> list[int]:
    """List the checks that may be a change's first: later than that of the last change, and not
    bad.
    """
    after = max((course.first for course in detected.courses), default=0)
    return [i for i in range(after + 1, last + 1) if i not in detected.bad]


def _select_until(series: Series, detected: PointChanges, last: int) -> np.ndarray:
    rows = np.arange(series.n) <= last
    rows[detected.bad] = False
    return rows


def _weigh_by_start(
    series: Series, detected: PointChanges, starts: list[int], last: int
) -> dict[bool, F64]:
    """Return the log ratio (k,) of a change from each of *starts* on, sudden and gradual."""
    rows = _select_until(series, detected, last)
    out = {}
    for gradual, sizes, share in (
        (False, STEPS, 1 - GRADUAL_SHARE),
        (True, RATES_PER_DAY, GRADUAL_SHARE),
    ):
        courses = [ChangeCourse(k, gradual).shape(series.instant_s) for k in starts]
        shapes = np.column_stack(courses)
        ratios = compute_log_ratios(series, rows, detected.courses, shapes, sizes)
        out[gradual] = ratios + math.log(share)
    return out


def _compute_statistic(series: Series, detected: PointChanges, row: int) -> float:
    starts = _list_starts(detected, row)
    if not starts or row in detected.bad:
        return -math.inf
    return float(logsumexp(list(_weigh_by_start(series, detected, starts, row).values())))


def _explain(series: Series, detected: PointChanges, row: int) -> tuple[int, PointChange | None]:
    """Explain an alarm at *row* by a bad check, whose index is returned, or by a change."""
    last = min(series.n - 1, row + LATER_CHECKS)
    starts = _list_starts(detected, row)
    change = {
        gradual: ratios + math.log(CHANGE_SHARE)
        for gradual, ratios in _weigh_by_start(series, detected, starts, last).items()
    }
    # If the alarm comes from the last check, it may be either; it counts as a change until another
    # check follows.
    bad_candidates = [i for i in starts if i < last]
    bad = np.full(1, -np.inf)
    if bad_candidates:
        shapes = np.eye(series.n)[:, bad_candidates]
        rows = _select_until(series, detected, last)
        bad = compute_log_ratios(series, rows, detected.courses, shapes, STEPS) + math.log(
            BAD_SHARE
        )
    every = logsumexp([*change[False], *change[True]])
    if logsumexp(bad) > every:
        return bad_candidates[int(np.argmax(bad))], None
    gradual = bool(logsumexp(change[True]) > logsumexp(change[False]))
    onset = np.logaddexp(change[False], change[True])
    share = np.exp(onset - logsumexp(onset)).cumsum()
    first = starts[int(np.argmax(change[gradual]))]
    earliest = starts[int(np.searchsorted(share, OUTSIDE / 2))]
    latest = starts[min(int(np.searchsorted(share, 1 - OUTSIDE / 2)), len(starts) - 1)]
    certain = float(np.exp(every - logsumexp([every, *bad, 0.0])))
    return -1, PointChange(
        ChangeCourse(first, gradual), min(earliest, first), max(latest, first), certain
    )

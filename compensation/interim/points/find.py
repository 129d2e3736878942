"""When the figures of an arm changed: check after check, each alarm with the checks since."""

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

#: An alarm is looked at with so many checks after it.
LATER_CHECKS = 5
#: How frequent changes and bad checks are taken to be, a check.
CHANGE_SHARE, BAD_SHARE = 1 / 100, 1 / 50
#: Of the interval that holds a change.
OUTSIDE = 0.05


@dataclass(frozen=True)
class PointChange:
    """A change, and how sure it is."""

    course: ChangeCourse
    earliest: int  # 95 %: the first check that has it is no earlier
    latest: int  # and no later than this
    probability: float  # that it is a change, and neither chance nor a bad check


@dataclass
class PointChanges:
    """What the checks show."""

    statistic: F64  # (n,) natural logarithm
    changes: list[PointChange] = field(default_factory=list)
    bad: list[int] = field(default_factory=list)

    @property
    def courses(self) -> list[ChangeCourse]:
        return [change.course for change in self.changes]


def find_changes(series: Series) -> PointChanges:
    """Watch the checks in order of time."""
    detected = PointChanges(np.full(series.n, -np.inf))
    row = 0
    while row < series.n:
        detected.statistic[row] = _compute_statistic(series, detected, row)
        if row not in detected.bad and detected.statistic[row] >= LIMIT:
            bad, change = _explain(series, detected, row)
            if change is None:
                detected.bad.append(bad)
                row = bad  # what came after it is watched without it
            else:
                detected.changes.append(change)
        row += 1
    detected.bad.sort()
    return detected


def _list_starts(detected: PointChanges, last: int) -> list[int]:
    """Checks that may be a change's first: after the last one's, and none that is bad."""
    after = max((course.first for course in detected.courses), default=0)
    return [i for i in range(after + 1, last + 1) if i not in detected.bad]


def _select_until(series: Series, detected: PointChanges, last: int) -> np.ndarray:
    rows = np.arange(series.n) <= last
    rows[detected.bad] = False
    return rows


def _weigh_by_start(
    series: Series, detected: PointChanges, starts: list[int], last: int
) -> dict[bool, F64]:
    """(k,) log of the ratio of a change from each of *starts* on, sudden and gradual."""
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
    """The bad check that an alarm at *row* was, or the change."""
    last = min(series.n - 1, row + LATER_CHECKS)
    starts = _list_starts(detected, row)
    change = {
        gradual: ratios + math.log(CHANGE_SHARE)
        for gradual, ratios in _weigh_by_start(series, detected, starts, last).items()
    }
    # The last check alone may be either: a change, until one comes after it.
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

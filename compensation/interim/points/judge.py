"""Judges a history of tables of points: epochs, their figures over time, and the changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from scipy import stats

from armd.arrays import F64
from armd.compensation.interim.points.evidence import ChangeSize, Series, fit_change_size
from armd.compensation.interim.points.figures import PointCheck
from armd.compensation.interim.points.find import PointChange, PointChanges, find_changes

#: The lower bound of a reading's noise, µm.
LEAST_UM = 0.1
#: The 2/3 power of a standard deviation is nearly normally distributed (Wilson and Hilferty, PNAS
#: 17, 1931), the deviation itself is not.
POWER = 2.0 / 3.0
CONFIDENCE = 0.95


@dataclass(frozen=True)
class FigureShift:
    """The shift of one figure by a change."""

    name: str
    before_um: float  # mean of the good checks before it
    change_um: float  # by the last check
    standard_uncertainty_um: float
    half_width_um: float  # of the 95 % interval
    significant: bool


@dataclass(frozen=True)
class PointEpoch:
    """Checks on one artefact with one tip, and their changes."""

    checks: tuple[PointCheck, ...]
    names: tuple[str, ...]  # of the figures
    value_um: F64  # (n, J); NaN where a check does not have a figure
    detected: PointChanges
    moved: tuple[tuple[FigureShift, ...], ...]  # for each change, the most significant figure first

    def verdict(self, index: int) -> str:
        """Return the verdict on one check, in the contract's words."""
        if index in self.detected.bad:
            return "bad_check"
        changed = any(index >= course.first for course in self.detected.courses)
        return "changed" if changed else "in_control"

    def between_unix_s(self, change: PointChange) -> tuple[float, float]:
        """Return the 95 % interval of a change, in seconds of Unix time."""
        before = [i for i in range(change.earliest) if i not in self.detected.bad]
        return self.checks[before[-1]].last_unix_s, self.checks[change.latest].first_unix_s


def judge_points(checks: Sequence[PointCheck]) -> list[PointEpoch]:
    """Judge the epochs of *checks*, which are in order of time; they are ordered by their latest
    check.
    """
    ordered = sorted(checks, key=lambda check: check.epoch)
    groups = [tuple(group) for _, group in groupby(ordered, key=lambda check: check.epoch)]
    epochs = [_judge_epoch(group) for group in groups]
    return sorted(epochs, key=lambda epoch: epoch.checks[-1].first_unix_s)


def _judge_epoch(checks: tuple[PointCheck, ...]) -> PointEpoch:
    names = tuple(dict.fromkeys(figure.name for check in checks for figure in check.figures))
    value_um, own_um = np.full((2, len(checks), len(names)), np.nan)
    freedom = np.zeros((len(checks), len(names)))
    for i, check in enumerate(checks):
        for figure in check.figures:
            j = names.index(figure.name)
            value_um[i, j], own_um[i, j] = 1e3 * figure.value_mm, 1e3 * figure.own_mm
            freedom[i, j] = figure.freedom
    spread = freedom.max(axis=0) > 0
    series = _make_series(checks, value_um, own_um, np.where(freedom > 0, freedom, np.nan), spread)
    detected = find_changes(series)
    moved = tuple(
        _list_moved(series, detected, change, names, value_um, spread)
        for change in detected.changes
    )
    return PointEpoch(checks, names, value_um, detected, moved)


def _make_series(
    checks: Sequence[PointCheck], value_um: F64, own_um: F64, freedom: F64, spread: F64
) -> Series:
    scaled = np.where(spread, np.abs(value_um) ** POWER, value_um)
    middle = np.nanmedian(np.abs(scaled), axis=0)
    own_deviation, least_deviation = np.full((2, value_um.shape[1]), np.nan)
    for j, is_spread in enumerate(spread):
        if is_spread:
            own_deviation[j] = middle[j] * math.sqrt(2 / (9 * float(np.nanmedian(freedom[:, j]))))
            least_deviation[j] = POWER * LEAST_UM * max(middle[j], 1e-6) ** (1 - 1 / POWER)
        else:
            finite_um = own_um[np.isfinite(own_um[:, j]), j]
            own_deviation[j] = (
                math.sqrt(float((finite_um**2).mean())) if len(finite_um) else math.nan
            )
            least_deviation[j] = LEAST_UM
    instants = np.array([check.first_unix_s for check in checks])
    return Series(scaled, own_deviation, least_deviation, instants)


def _list_moved(
    series: Series,
    detected: PointChanges,
    change: PointChange,
    names: Sequence[str],
    value_um: F64,
    spread: F64,
) -> tuple[FigureShift, ...]:
    rows = np.ones(series.n, bool)
    rows[detected.bad] = False
    other_courses = [course for course in detected.courses if course is not change.course]
    change_size = fit_change_size(series, rows, other_courses, change.course)
    before = rows & (np.arange(series.n) < change.course.first)
    named_figures = []
    for j, name in enumerate(names):
        if math.isfinite(change_size.value[j]) and np.isfinite(value_um[before, j]).any():
            named_figures.append(
                (_to_um(change_size, j, series.value[before, j], bool(spread[j])), name)
            )
    named_figures.sort(key=lambda pair: -abs(pair[0][1] / max(pair[0][2], 1e-12)))
    return tuple(FigureShift(name, *figures) for figures, name in named_figures)


def _to_um(
    change_size: ChangeSize, j: int, before: F64, spread: bool
) -> tuple[float, float, float, float, bool]:
    """Convert a change to µm.

    Returns the mean before, the change, its standard uncertainty, half of its interval, and whether
    it is significant.
    """
    level, value, deviation = (
        float(np.nanmean(before)),
        float(change_size.value[j]),
        change_size.deviation[j],
    )
    quantile = float(stats.t.ppf(0.5 + CONFIDENCE / 2, change_size.freedom[j]))
    significant = abs(value) > quantile * deviation
    if spread:
        after = max(level + value, 1e-9)
        steep = after ** (1 / POWER - 1) / POWER
        level, value = level ** (1 / POWER), after ** (1 / POWER) - level ** (1 / POWER)
        deviation = deviation * steep
    return level, value, float(deviation), quantile * float(deviation), bool(significant)

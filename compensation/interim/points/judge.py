"""A history of tables of points, judged: epochs, their figures over time, and the changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from scipy import stats

from armd.arrays import F64
from armd.compensation.interim.points.evidence import ChangeSize, Series, effect
from armd.compensation.interim.points.figures import PointCheck
from armd.compensation.interim.points.find import PointChange, PointChanges, find_changes

#: A reading's own noise is no smaller, µm.
LEAST_UM = 0.1
#: The 2/3 power of a standard deviation is near normally distributed (Wilson and Hilferty, PNAS 17,
#: 1931), the deviation itself is not.
POWER = 2.0 / 3.0
CONFIDENCE = 0.95


@dataclass(frozen=True)
class Moved:
    """How far a change moved one figure."""

    name: str
    before_um: float  # mean of the good checks before it
    change_um: float  # by the last check
    standard_uncertainty_um: float
    half_width_um: float  # of the 95 % interval
    significant: bool


@dataclass(frozen=True)
class PointEpoch:
    """Checks on one artefact, and what they show."""

    checks: tuple[PointCheck, ...]
    names: tuple[str, ...]  # of the figures
    value_um: F64  # (n, J); NaN where a check does not have a figure
    found: PointChanges
    moved: tuple[tuple[Moved, ...], ...]  # of each change, the surest figure first

    def verdict(self, index: int) -> str:
        """Of one check, as the contract names it."""
        if index in self.found.bad:
            return "bad_check"
        changed = any(index >= course.first for course in self.found.courses)
        return "changed" if changed else "in_control"

    def between_unix_s(self, change: PointChange) -> tuple[float, float]:
        """The instants between which a change happened, 95 %."""
        before = [i for i in range(change.earliest) if i not in self.found.bad]
        return self.checks[before[-1]].last_unix_s, self.checks[change.latest].first_unix_s


def judge_points(checks: Sequence[PointCheck]) -> list[PointEpoch]:
    """The epochs of *checks*, which are in order of time, by their latest check."""
    ordered = sorted(checks, key=lambda check: check.epoch)
    groups = [tuple(group) for _, group in groupby(ordered, key=lambda check: check.epoch)]
    epochs = [_epoch(group) for group in groups]
    return sorted(epochs, key=lambda epoch: epoch.checks[-1].first_unix_s)


def _epoch(checks: tuple[PointCheck, ...]) -> PointEpoch:
    names = tuple(dict.fromkeys(figure.name for check in checks for figure in check.figures))
    value_um, own_um = np.full((2, len(checks), len(names)), np.nan)
    freedom = np.zeros((len(checks), len(names)))
    for i, check in enumerate(checks):
        for figure in check.figures:
            j = names.index(figure.name)
            value_um[i, j], own_um[i, j] = 1e3 * figure.value_mm, 1e3 * figure.own_mm
            freedom[i, j] = figure.freedom
    spread = freedom.max(axis=0) > 0
    series = _series(checks, value_um, own_um, np.where(freedom > 0, freedom, np.nan), spread)
    found = find_changes(series)
    moved = tuple(
        _moved(series, found, change, names, value_um, spread) for change in found.changes
    )
    return PointEpoch(checks, names, value_um, found, moved)


def _series(
    checks: Sequence[PointCheck], value_um: F64, own_um: F64, freedom: F64, spread: F64
) -> Series:
    scaled = np.where(spread, np.abs(value_um) ** POWER, value_um)
    middle = np.nanmedian(np.abs(scaled), axis=0)
    own, least = np.full((2, value_um.shape[1]), np.nan)
    for j, is_spread in enumerate(spread):
        if is_spread:
            own[j] = middle[j] * math.sqrt(2 / (9 * float(np.nanmedian(freedom[:, j]))))
            least[j] = POWER * LEAST_UM * max(middle[j], 1e-6) ** (1 - 1 / POWER)
        else:
            known = own_um[np.isfinite(own_um[:, j]), j]
            own[j] = math.sqrt(float((known**2).mean())) if len(known) else math.nan
            least[j] = LEAST_UM
    instants = np.array([check.first_unix_s for check in checks])
    return Series(scaled, own, least, instants)


def _moved(
    series: Series,
    found: PointChanges,
    change: PointChange,
    names: Sequence[str],
    value_um: F64,
    spread: F64,
) -> tuple[Moved, ...]:
    rows = np.ones(series.n, bool)
    rows[found.bad] = False
    others = [course for course in found.courses if course is not change.course]
    made = effect(series, rows, others, change.course)
    before = rows & (np.arange(series.n) < change.course.first)
    each = []
    for j, name in enumerate(names):
        if math.isfinite(made.value[j]) and np.isfinite(value_um[before, j]).any():
            each.append((_in_um(made, j, series.value[before, j], bool(spread[j])), name))
    each.sort(key=lambda one: -abs(one[0][1] / max(one[0][2], 1e-12)))
    return tuple(Moved(name, *figures) for figures, name in each)


def _in_um(
    made: ChangeSize, j: int, before: F64, spread: bool
) -> tuple[float, float, float, float, bool]:
    """Mean before, change, its standard uncertainty, half of its interval; whether it is sure."""
    level, value, deviation = float(np.nanmean(before)), float(made.value[j]), made.deviation[j]
    quantile = float(stats.t.ppf(0.5 + CONFIDENCE / 2, made.freedom[j]))
    significant = abs(value) > quantile * deviation
    if spread:
        after = max(level + value, 1e-9)
        steep = after ** (1 / POWER - 1) / POWER
        level, value = level ** (1 / POWER), after ** (1 / POWER) - level ** (1 / POWER)
        deviation = deviation * steep
    return level, value, float(deviation), quantile * float(deviation), bool(significant)

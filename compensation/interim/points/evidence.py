"""The likelihood ratio of a series of figures with a change to without.

One figure in n checks is y = level + β·course + noise of unknown size σ. The level has a flat
prior. That of σ is worth s checks, whose scatter is predicted from the readings inside the checks.
β/σ has a normal prior of standard deviation g. Integrated over all three, the ratio of the
likelihoods is (Liang et al., JASA 103, 2008, equation 5, with a fixed g)

    (1 + g²·x'x)^(-1/2) · (1 − g²(x'y)² / ((1 + g²·x'x)(y'y + s·u²)))^(-(n − p + s)/2)

where the p known courses are eliminated from x and y. Averaged over courses and figures, and summed
over the checks at which a change may have begun, this is the statistic of Shiryaev and Roberts.
Without a change it rises by one a check on average. So it reaches 500 at most once in 500 checks
(Pollak, Ann. Stat. 13, 1985), whatever the correlation of the figures' noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp

from armd.arrays import F64, Mask
from armd.compensation.model.slow_factors import DAY_S

#: At most one false alarm occurs in this many checks.
RUN_LENGTH = 500.0
LIMIT = math.log(RUN_LENGTH)
#: The scatter inside the checks weighs as much as this many checks in the estimate of the scatter
#: between checks. That is larger by this factor: seats, operator and day differ as well.
OWN_SCATTER_CHECKS, OWN_SCATTER_FACTOR = 4.0, 1.5
#: Prior standard deviations of steps, in units of the noise, and of growths, in these units a day;
#: those of one kind are equally likely.
STEPS, RATES_PER_DAY = (3.0, 30.0), (0.01, 0.1, 1.0)
GRADUAL_SHARE = 0.2


@dataclass(frozen=True)
class Series:
    """J figures of n checks; NaN where a check does not have a figure."""

    value: F64  # (n, J), scaled so that their noise is near a normal one
    own_deviation: (
        F64  # (J,) their standard uncertainty from the scatter inside a check; NaN unknown
    )
    least_deviation: F64  # (J,) lower bound of the noise
    instant_s: F64  # (n,) Unix time

    @property
    def n(self) -> int:
        return len(self.value)


@dataclass(frozen=True)
class ChangeCourse:
    """The course of a change from its *first* check on."""

    first: int
    gradual: bool

    def shape(self, instant_s: F64) -> F64:
        """Return the course (n,): 0 before; then 1, or days since the last check before it."""
        since = np.arange(len(instant_s)) >= self.first
        if not self.gradual:
            return since.astype(float)
        return np.where(since, (instant_s - instant_s[self.first - 1]) / DAY_S, 0.0)


def compute_log_ratios(
    series: Series,
    rows: Mask,
    known_courses: Sequence[ChangeCourse],
    shapes: F64,
    sizes: Sequence[float],
) -> F64:
    """Return the log ratio for each column of *shapes* (n, m), averaged over *sizes* and figures.

    The result has shape (m,). The checks *rows* (n,) take part; the *known_courses* have free
    amplitudes.
    """
    ratios = []
    for j in range(series.value.shape[1]):
        has_figure = rows & np.isfinite(series.value[:, j])
        if has_figure.sum() < 2:
            ratios.append(np.zeros((shapes.shape[1], len(sizes))))
            continue
        y, x, freedom, squares = _clear_columns(series, j, has_figure, known_courses, shapes)
        xx, xy = (x**2).sum(axis=0)[:, None], (y @ x)[:, None]
        gain = 1.0 + np.square(sizes) * xx
        rest = 1.0 - np.square(sizes) * xy**2 / (gain * squares)
        ratios.append(-0.5 * np.log(gain) - 0.5 * freedom * np.log(np.maximum(rest, 1e-300)))
    stacked = np.stack(ratios)
    out: F64 = logsumexp(stacked, axis=(0, 2)) - math.log(stacked.shape[0] * len(sizes))
    return out


def _clear_columns(
    series: Series, j: int, has_figure: Mask, known_courses: Sequence[ChangeCourse], shapes: F64
) -> tuple[F64, F64, float, float]:
    """Eliminate the level and the known courses from a figure and from *shapes*.

    Also returns the degrees of freedom and the sum of squares.
    """
    nuisance = [np.ones(series.n)] + [course.shape(series.instant_s) for course in known_courses]
    basis, _ = np.linalg.qr(_make_full_rank(np.column_stack(nuisance)[has_figure]))
    y, x = series.value[has_figure, j], shapes[has_figure]
    y, x = y - basis @ (basis.T @ y), x - basis @ (basis.T @ x)
    freedom = float(len(y) - basis.shape[1])
    squares = float(y @ y) + max(freedom, 1.0) * float(series.least_deviation[j]) ** 2
    scatter = float(series.own_deviation[j]) * OWN_SCATTER_FACTOR
    if math.isfinite(scatter):
        freedom, squares = freedom + OWN_SCATTER_CHECKS, squares + OWN_SCATTER_CHECKS * scatter**2
    return y, x, freedom, squares


def _make_full_rank(columns: F64) -> F64:
    """Drop columns that depend on earlier ones, where a figure is missing in some checks."""
    basis = columns[:, :1]
    for column in columns.T[1:]:
        extended = np.column_stack([basis, column])
        basis = extended if np.linalg.matrix_rank(extended) > basis.shape[1] else basis
    return basis


@dataclass(frozen=True)
class ChangeSize:
    """The shift of each figure by a change, up to the last check, in the figures' scale."""

    value: F64  # (J,); NaN where a figure does not show it
    deviation: F64  # (J,) standard uncertainty
    freedom: F64  # (J,) its degrees of freedom


def fit_change_size(
    series: Series, rows: Mask, known_courses: Sequence[ChangeCourse], course: ChangeCourse
) -> ChangeSize:
    """Fit the size of *course* together with the *known_courses* by least squares."""
    shape = course.shape(series.instant_s)
    value, deviation, freedom = np.full((3, series.value.shape[1]), np.nan)
    for j in range(series.value.shape[1]):
        has_figure = rows & np.isfinite(series.value[:, j])
        if has_figure.sum() < 2:
            continue
        y, x, free, squares = _clear_columns(series, j, has_figure, known_courses, shape[:, None])
        xx = float((x**2).sum())
        if xx < 1e-12 or free <= 1:
            continue
        slope = float(y @ x[:, 0]) / xx
        residual_square = max(squares - slope**2 * xx, 0.0)
        value[j], freedom[j] = slope * shape[-1], free - 1
        deviation[j] = math.sqrt(residual_square / (free - 1) / xx) * shape[-1]
    return ChangeSize(value, deviation, freedom)

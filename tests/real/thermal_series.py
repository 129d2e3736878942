"""Displacements against temperatures, without kinematics: does a static model miss a lag?

A machine element that warms is not where its sensors' present readings say, but where their past
says. The same criterion as for an arm's link, asked of plain time series: temperatures delayed by
a first-order lag join a static linear model if they lower its error on later time.

Everything is chosen on the first part of time, by fitting its beginning and judging what follows:
the time constant, and how strongly sensors that move together share the work (a ridge). One of
each for all displacements of a machine: both belong to its body and its sensors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from armd.arrays import F64
from armd.compensation.model.state import apply_lag

TIME_CONSTANTS_S = (120.0, 300.0, 600.0, 1200.0, 2400.0, 4800.0, 9600.0)
#: Ridge penalties relative to a column's variance.
RIDGES = tuple(10.0 ** (k / 2) for k in range(-10, 2))
#: Ends of the parts of the first time: each is judged by a model of all before it.
STAGES = (1 / 3, 1 / 2, 2 / 3, 5 / 6, 1.0)
#: The lagged model must lower the error by this much to be named.
WORTH = 0.97
BLOCK_S = 3600.0  # of time, resampled together
RESAMPLES = 1000


@dataclass(frozen=True)
class ThermalSeries:
    """What the static and the lagged model reach for one displacement on the later time."""

    mean_um: float  # RMSE with the mean only
    static_um: float
    lagged_um: float
    gain_um: tuple[float, float]  # 95 % of static minus lagged, resampled by the hour
    time_constant_s: float | None  # None: the static model misses no lag
    static_memory: float  # autocorrelation of the static residual after an hour
    lag_found: bool  # decided on the first time alone


def diagnose_series(
    time_s: F64, temperature_c: F64, displacement_um: F64, train: float = 0.6
) -> list[ThermalSeries]:
    """Fit on the first *train* of time, judge on the rest; one result per displacement.

    Times (n,), temperatures (n, S), displacements (n, D).
    """
    n = int(train * len(time_s))
    later = slice(n, None)
    y = displacement_um
    series = np.zeros(len(time_s), dtype=np.int64)
    static = temperature_c
    delayed = {
        lag: np.hstack([static, apply_lag(time_s, static, series, lag)]) for lag in TIME_CONSTANTS_S
    }
    static_errors = _errors_ahead(static[:n], y[:n])
    errors = {lag: _errors_ahead(x[:n], y[:n]) for lag, x in delayed.items()}
    lag = min(errors, key=lambda key: _together(errors[key]).min())
    before, ridge_before = _best(static_errors)
    after, ridge_after = _best(errors[lag])
    found = after < WORTH * before
    left = y - _ridge(static[:n], y[:n], static, [ridge_before])[0]
    with_lag = y - _ridge(delayed[lag][:n], y[:n], delayed[lag], [ridge_after])[0]
    step_s = float(np.median(np.diff(time_s)))
    return [
        ThermalSeries(
            mean_um=_rms(y[later, d] - y[:n, d].mean()),
            static_um=_rms(left[later, d]),
            lagged_um=_rms(with_lag[later, d]),
            gain_um=_interval(left[later, d], with_lag[later, d], step_s),
            time_constant_s=lag if found else None,
            static_memory=_memory(left[later, d], step_s),
            lag_found=found,
        )
        for d in range(y.shape[1])
    ]


def _errors_ahead(x: F64, y: F64) -> F64:
    """RMSE (ridges, D) on parts of time ahead of the one fitted."""
    left: list[list[F64]] = [[] for _ in RIDGES]
    for start, end in pairwise(int(stage * len(y)) for stage in STAGES):
        predicted = _ridge(x[:start], y[:start], x[start:end], RIDGES)
        for own, values in zip(left, predicted, strict=True):
            own.append(y[start:end] - values)
    return np.array([np.sqrt((np.concatenate(own) ** 2).mean(axis=0)) for own in left])


def _together(errors: F64) -> F64:
    """(ridges,) one figure for all displacements: the mean of the errors' logarithms."""
    figure: F64 = np.log(np.maximum(errors, 1e-12)).mean(axis=1)
    return figure


def _best(errors: F64) -> tuple[float, float]:
    """The error of all displacements together (geometric mean) at its best ridge, and that."""
    together = _together(errors)
    best = int(np.argmin(together))
    return float(np.exp(together[best])), RIDGES[best]


def _ridge(x: F64, y: F64, at: F64, ridges: Sequence[float]) -> list[F64]:
    """Ridge regressions with a constant, columns scaled to unit variance: y (m, D) at *at*."""
    centre, spread = x.mean(axis=0), x.std(axis=0)
    spread = np.where(spread > 0, spread, 1.0)
    scaled = (x - centre) / spread
    values, vectors = np.linalg.eigh(scaled.T @ scaled / len(y))
    side = vectors.T @ (scaled.T @ (y - y.mean(axis=0)) / len(y))
    turned = ((at - centre) / spread) @ vectors
    return [y.mean(axis=0) + turned @ (side / (values[:, None] + ridge)) for ridge in ridges]


def _interval(before: F64, after: F64, step_s: float) -> tuple[float, float]:
    """95 % interval of the fall in RMSE, blocks of time resampled together."""
    blocks = np.arange(len(before)) // max(1, round(BLOCK_S / step_s))
    sums = np.stack([np.bincount(blocks, values) for values in (before**2, after**2)])
    size = np.bincount(blocks)
    draws = np.random.default_rng(1).integers(len(size), size=(RESAMPLES, len(size)))
    total = size[draws].sum(axis=1)
    fall = np.sqrt(sums[0][draws].sum(axis=1) / total) - np.sqrt(sums[1][draws].sum(axis=1) / total)
    low, high = np.quantile(fall, [0.025, 0.975])
    return float(low), float(high)


def _memory(left: F64, step_s: float) -> float:
    """Autocorrelation after one hour."""
    shift = max(1, round(3600.0 / step_s))
    centred = left - left.mean()
    return float(centred[:-shift] @ centred[shift:] / (centred @ centred))


def _rms(values: F64) -> float:
    return float(np.sqrt((values**2).mean()))

"""Displacements against temperatures, without kinematics: does a static model miss a lag?

A machine element that warms is not where its sensors' present readings say, but where their past
says. The same question as for an arm's link, asked of a plain time series: temperatures delayed
by a first-order lag join a static linear model if they lower its error on later time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.compensation.state import lagged

F64 = npt.NDArray[np.float64]

TIME_CONSTANTS_S = (120.0, 300.0, 600.0, 1200.0, 2400.0, 4800.0, 9600.0)
#: Ridge penalty relative to a column's variance: sensors that move together share the work.
RIDGE = 1e-2
FOLDS = 5
#: The lagged model must lower the error on left-out time by this much to be named.
WORTH = 0.97


@dataclass(frozen=True)
class ThermalSeries:
    """What the static and the lagged model reach on the time after the one fitted."""

    mean_um: float  # RMSE with the mean only
    static_um: float
    lagged_um: float
    time_constant_s: float | None  # None: the static model misses no lag
    static_memory: float  # autocorrelation of the static residual after an hour
    lag_found: bool  # decided on the fitted time alone


def diagnose_series(
    time_s: F64, temperature_c: F64, displacement_um: F64, train: float = 0.6
) -> ThermalSeries:
    """Fit on the first *train* of time, judge on the rest.

    Times (n,), temperatures (n, S), displacement (n,). Whether a lag is missed, and its time
    constant, are decided by leaving out blocks of the first part.
    """
    n = int(train * len(time_s))
    fitted, later = slice(0, n), slice(n, None)
    static = temperature_c
    series = np.zeros(len(time_s), dtype=np.int64)
    choices = {
        lag: np.hstack([static, lagged(time_s, static, series, lag)]) for lag in TIME_CONSTANTS_S
    }
    static_error = _left_out(static[fitted], displacement_um[fitted])
    errors = {lag: _left_out(x[fitted], displacement_um[fitted]) for lag, x in choices.items()}
    lag = min(errors, key=lambda key: errors[key])
    found = errors[lag] < WORTH * static_error
    left = displacement_um - _predict(static, displacement_um, fitted)
    with_lag = displacement_um - _predict(choices[lag], displacement_um, fitted)
    return ThermalSeries(
        mean_um=_rms(displacement_um[later] - displacement_um[fitted].mean()),
        static_um=_rms(left[later]),
        lagged_um=_rms(with_lag[later]),
        time_constant_s=lag if found else None,
        static_memory=_memory(left[later], float(np.median(np.diff(time_s)))),
        lag_found=found,
    )


def _left_out(x: F64, y: F64) -> float:
    """RMSE over blocks of time left out in turn."""
    blocks = np.arange(len(y)) * FOLDS // len(y)
    left = [
        y[blocks == b] - _ridge(x[blocks != b], y[blocks != b], x[blocks == b])
        for b in range(FOLDS)
    ]
    return _rms(np.concatenate(left))


def _predict(x: F64, y: F64, fitted: slice) -> F64:
    return _ridge(x[fitted], y[fitted], x)


def _ridge(x: F64, y: F64, at: F64) -> F64:
    """Ridge regression with a constant, columns scaled to unit variance."""
    centre, spread = x.mean(axis=0), x.std(axis=0)
    spread = np.where(spread > 0, spread, 1.0)
    scaled = (x - centre) / spread
    gram = scaled.T @ scaled / len(y) + RIDGE * np.eye(x.shape[1])
    slope = np.linalg.solve(gram, scaled.T @ (y - y.mean()) / len(y))
    predicted: F64 = y.mean() + ((at - centre) / spread) @ slope
    return predicted


def _memory(left: F64, step_s: float) -> float:
    """Autocorrelation after one hour."""
    shift = max(1, round(3600.0 / step_s))
    centred = left - left.mean()
    return float(centred[:-shift] @ centred[shift:] / (centred @ centred))


def _rms(values: F64) -> float:
    return float(np.sqrt((values**2).mean()))

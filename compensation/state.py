"""What the arm knew at each reading, and how a temperature is delayed in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.jit import jit

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


@dataclass(frozen=True)
class States:
    """n instants of an arm of N joints and S sensors."""

    q: F64  # (n, N) rad, as read (before the θ offset); signed as it stands
    rate: F64  # (n, N) rad/s, NaN missing; its sign is the side of approach
    temperature_c: F64  # (n, S) in the order of arm.sensors, NaN missing
    time_s: F64  # (n,) Unix seconds; NaN missing, in a whole session
    approach: F64  # (n, 3) unit vectors, base frame, NaN missing
    series: I64  # (n,) rows with one number are one run in time; lags are filtered within it

    @property
    def n(self) -> int:
        return len(self.q)

    def rows(self, chosen: npt.NDArray[np.bool_] | I64 | slice) -> States:
        """The chosen rows only. Lags want all rows of a run: evaluate them before choosing."""
        return States(
            self.q[chosen],
            self.rate[chosen],
            self.temperature_c[chosen],
            self.time_s[chosen],
            self.approach[chosen],
            self.series[chosen],
        )


class Lag:
    """S temperatures delayed by τ·dy/dt = x − y, fed row by row or in arrays alike.

    Exact for an input that runs straight between its readings; starts settled at the first value
    of each sensor. A missing value or time (NaN) gives NaN for that row and is bridged by a
    straight line.
    """

    def __init__(self, lag_s: float, n_sensors: int) -> None:
        self.lag_s = lag_s
        self._time_s = np.full(n_sensors, np.nan)
        self._value = np.zeros(n_sensors)
        self._delayed = np.zeros(n_sensors)

    def follow(self, time_s: F64, values: F64) -> F64:
        """Delayed values (n, S) of *values* (n, S) at ascending times (n,) in s."""
        delayed = np.empty(values.shape)
        _follow(
            time_s, np.ascontiguousarray(values), self.lag_s,
            self._time_s, self._value, self._delayed, delayed,
        )  # fmt: skip
        return delayed


def lagged(time_s: F64, values: F64, series: I64, lag_s: float) -> F64:
    """*values* (n, S) delayed by *lag_s* within each series; rows may stand in any order."""
    if lag_s == 0:
        return values
    delayed = np.empty(values.shape)
    for run in np.unique(series):
        rows = np.flatnonzero(series == run)
        rows = rows[np.argsort(time_s[rows], kind="stable")]
        delayed[rows] = Lag(lag_s, values.shape[1]).follow(time_s[rows], values[rows])
    return delayed


@jit
def _follow(
    time_s: F64, values: F64, lag_s: float, last_s: F64, last: F64, state: F64, delayed: F64
) -> None:
    n, sensors = values.shape
    for s in range(sensors):
        for i in range(n):
            x = values[i, s]
            if np.isnan(x) or np.isnan(time_s[i]):
                delayed[i, s] = np.nan
                continue
            dt = time_s[i] - last_s[s]
            if np.isnan(dt):  # the first value
                state[s] = x
            elif dt > 0:
                # x runs straight with slope r: y follows it τ behind, plus what decays.
                behind = (x - last[s]) / dt * lag_s
                state[s] = x - behind + (state[s] - last[s] + behind) * np.exp(-dt / lag_s)
            last[s] = x
            last_s[s] = time_s[i]
            delayed[i, s] = state[s]

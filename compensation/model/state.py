"""The state of the arm at each reading, and the delay of a temperature in time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compiled.jit import jit


@dataclass(frozen=True)
class States:
    """n instants of an arm of N joints and S sensors."""

    q: F64  # (n, N) rad, as read (before the θ offset), signed
    rate: F64  # (n, N) rad/s, NaN missing; its sign is the side of approach
    temperature_c: F64  # (n, S) in the order of arm.sensors, NaN missing
    time_s: F64  # (n,) Unix seconds; NaN for a whole session if missing
    approach: F64  # (n, 3) unit vectors, base frame, NaN missing
    series: I64  # (n,) rows with equal numbers are one series in time; lags are filtered within it

    @property
    def n(self) -> int:
        return len(self.q)

    @classmethod
    def joined(cls, parts: Sequence[States]) -> States:
        """Join the rows of several states; their series numbers stay as they are."""
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def rows(self, chosen: Mask | I64 | slice) -> States:
        """Return the chosen rows. Evaluate lags before, because they need all rows of a series."""
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

    It is exact for an input that is linear between its readings, and starts settled at the first
    value of each sensor. A missing value or time (NaN) gives NaN for that row and is bridged
    linearly.
    """

    def __init__(self, lag_s: float, n_sensors: int) -> None:
        self.lag_s = lag_s
        self._memory = np.full((n_sensors, 3), np.nan)

    def follow(self, time_s: F64, values: F64) -> F64:
        """Return delayed values (n, S) of *values* (n, S) at ascending times (n,) in s."""
        return follow_lag(time_s, values, self.lag_s, self._memory)


def follow_lag(time_s: F64, values: F64, lag_s: float, memory: F64) -> F64:
    """Return delayed values as `Lag.follow`.

    *memory* (S, 3) holds the state of `update_lag`, NaN before the first value.
    """
    delayed = np.empty(values.shape)
    _follow(time_s, np.ascontiguousarray(values), lag_s, memory, delayed)
    return delayed


def apply_lag(time_s: F64, values: F64, series: I64, lag_s: float) -> F64:
    """Delay *values* (n, S) by *lag_s* within each series; rows may be in any order."""
    if lag_s == 0:
        return values
    delayed = np.empty(values.shape)
    for run in np.unique(series):
        rows = np.flatnonzero(series == run)
        rows = rows[np.argsort(time_s[rows], kind="stable")]
        delayed[rows] = Lag(lag_s, values.shape[1]).follow(time_s[rows], values[rows])
    return delayed


@jit
def _follow(time_s: F64, values: F64, lag_s: float, memory: F64, delayed: F64) -> None:
    for s in range(values.shape[1]):
        for i in range(len(values)):
            delayed[i, s] = update_lag(values[i, s], time_s[i], lag_s, memory, s)


@jit
def update_lag(x: float, time_s: float, lag_s: float, memory: F64, s: int) -> float:
    """Return the delayed value of sensor *s* at its next reading *x*.

    *memory* (S, 3): time, value and delayed value of the last reading.
    """
    if math.isnan(x) or math.isnan(time_s):
        return math.nan
    dt = time_s - memory[s, 0]
    if math.isnan(dt):  # the first value
        memory[s, 2] = x
    elif dt > 0:
        # x is linear with slope r: y lags it by τ, plus a decaying part.
        last, delayed = memory[s, 1], memory[s, 2]
        behind = (x - last) / dt * lag_s
        memory[s, 2] = x - behind + (delayed - last + behind) * math.exp(-dt / lag_s)
    memory[s, 0], memory[s, 1] = time_s, x
    return float(memory[s, 2])

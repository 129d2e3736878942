"""The noise of a temperature sensor from reading to reading, estimated from the sessions."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from armd.arrays import F64
from armd.compensation.model.state import States

#: Share of the residuals that is used: the rest may be steps of the true temperature (a table that
#: has one value for each placement). In a normal distribution it has this share of the variance.
KEPT, KEPT_VARIANCE = 0.9, 0.623
#: With fewer residuals the noise is not estimated.
LEAST = 10
#: Readings further apart than this, in seconds, are not compared.
SPAN_S = 1800.0


def estimate_sensor_noise_c(states: States, sensors: Iterable[int]) -> float:
    """Return the standard deviation of one reading in °C, of the worst of *sensors* (columns).

    It is 0 if the readings do not show any. A true temperature is nearly linear over three readings
    in a row. So the deviation of the middle one from that line is noise, of variance (1 + w² + (1 −
    w)²) σ² for the weights w and 1 − w of its neighbours.
    """
    return max((_estimate_noise_c(states, sensor) for sensor in sensors), default=0.0)


def _estimate_noise_c(states: States, sensor: int) -> float:
    squares: list[F64] = []
    for series in np.unique(states.series):
        rows = np.flatnonzero(states.series == series)
        celsius, time_s = states.temperature_c[rows, sensor], states.time_s[rows]
        is_known = np.isfinite(celsius) & np.isfinite(time_s)
        order = np.argsort(time_s[is_known], kind="stable")
        c, t = celsius[is_known][order], time_s[is_known][order]
        if len(c) < 3:
            continue
        span = t[2:] - t[:-2]
        close = (span > 0) & (span < SPAN_S)
        w = (t[2:] - t[1:-1])[close] / span[close]
        off = c[1:-1][close] - w * c[:-2][close] - (1 - w) * c[2:][close]
        squares.append(off**2 / (1 + w**2 + (1 - w) ** 2))
    sorted_squares = np.sort(np.concatenate(squares)) if squares else np.zeros(0)
    if len(sorted_squares) < LEAST:
        return 0.0
    bulk = sorted_squares[: int(KEPT * len(sorted_squares))]
    return float(np.sqrt(bulk.mean() / KEPT_VARIANCE))

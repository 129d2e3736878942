"""A lag hidden in plain time series is found; where there is none, none is."""

from __future__ import annotations

import numpy as np
import pytest
from convert import VENDORED
from diagnosis_marks import spindle
from rich.console import Console
from thermal_series import diagnose_series

HOURS, STEP_S = 40, 30.0


def _temperatures(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Times (n,) and three sensors (n, 3) near a spindle that runs and stops at random."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, HOURS * 3600.0, STEP_S)
    heat = np.repeat(rng.uniform(0.0, 20.0, HOURS), round(3600.0 / STEP_S))
    sensors = np.empty((len(time_s), 3))
    state = np.array([0.0, 0.0, 0.0])
    for i, power in enumerate(heat):
        state = state + STEP_S * (power - state) / np.array([300.0, 900.0, 4000.0])
        sensors[i] = 20.0 + state + rng.normal(0.0, 0.02, 3)
    return time_s, sensors


@pytest.mark.parametrize("lag_s", [0.0, 2400.0])
def test_a_lag_is_found_where_there_is_one(lag_s: float) -> None:
    time_s, sensors = _temperatures(3)
    body = sensors[:, 0].copy()
    if lag_s:
        for i in range(1, len(body)):
            body[i] = body[i - 1] + STEP_S / lag_s * (sensors[i, 0] - body[i - 1])
    noise = np.random.default_rng(4).normal(0.0, 0.3, (len(body), 2))
    displacements = np.stack([3.0 * body, -2.0 * body], axis=1) + noise
    for found in diagnose_series(time_s, sensors, displacements):
        assert found.lag_found == (lag_s > 0)
        if lag_s:
            assert found.time_constant_s is not None
            assert abs(np.log2(found.time_constant_s / lag_s)) <= 1.01
            assert found.lagged_um < 0.7 * found.static_um
            assert found.gain_um[0] > 0


def test_the_spindle_s_static_model_misses_a_lag() -> None:
    assert spindle(VENDORED / "spindle_thermal" / "readings.csv", Console(quiet=True)) == []

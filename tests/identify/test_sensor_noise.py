"""What sessions show of a temperature sensor's own scatter, and that calibrate writes it."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.estimate.noise.sensor import estimate_sensor_noise_c
from armd.compensation.model.state import States


def states_of(celsius: np.ndarray, time_s: np.ndarray, series: np.ndarray | int = 0) -> States:
    n = len(celsius)
    nothing = np.full((n, 3), np.nan)
    runs = np.zeros(n, np.int64) + series
    return States(nothing, nothing, celsius.reshape(n, -1), time_s, nothing, runs)


@pytest.mark.parametrize("sigma_c", [0.0, 0.005, 0.05])
def test_scatter_about_a_temperature_that_drifts_irregularly_read(sigma_c):
    rng = np.random.default_rng(1)
    time_s = np.cumsum(rng.exponential(6.0, 2000))
    true_c = 20 + 8 * (1 - np.exp(-time_s / 3600))
    celsius = true_c + rng.normal(0, sigma_c, len(time_s))
    found = estimate_sensor_noise_c(states_of(celsius, time_s), [0])
    assert found == pytest.approx(sigma_c, rel=0.06, abs=1e-4)
    shuffled = rng.permutation(len(time_s))
    again = estimate_sensor_noise_c(states_of(celsius[shuffled], time_s[shuffled]), [0])
    assert again == pytest.approx(found)


def test_the_worst_sensor_counts_and_gaps_do_not():
    rng = np.random.default_rng(2)
    celsius = 20 + rng.normal(0, 1, (500, 3)) * [0.01, 0.03, 1.0]
    celsius[::7, 1] = np.nan
    found = estimate_sensor_noise_c(states_of(celsius, np.arange(500) * 5.0), [0, 1])
    assert found == pytest.approx(0.03, rel=0.15)


def test_one_temperature_for_each_placement_shows_no_scatter():
    celsius = np.repeat([20.0, 22.5, 25.0, 28.0], 40)
    states = states_of(celsius, np.arange(160) * 10.0)
    assert estimate_sensor_noise_c(states, [0]) == 0.0
    assert estimate_sensor_noise_c(states_of(celsius[:8], np.arange(8.0)), [0]) == 0.0
    assert estimate_sensor_noise_c(states, []) == 0.0

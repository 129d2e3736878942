"""The first-order lag against its differential equation, and fed live against all at once."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from armd.compensation.model.state import Lag, apply_lag


def test_lag_solves_its_equation_for_straight_stretches() -> None:
    time_s = np.array([0.0, 3.0, 4.0, 60.0, 61.0, 400.0])
    values = np.array([20.0, 22.0, 22.0, 30.0, 25.0, 25.0])
    solution = solve_ivp(
        lambda t, y: (np.interp(t, time_s, values) - y) / 40.0,
        (0.0, 400.0), [20.0], t_eval=time_s, rtol=1e-10, atol=1e-10, max_step=0.5,
    )  # fmt: skip
    delayed = apply_lag(time_s, values[:, None], np.zeros(6, np.int64), 40.0)[:, 0]
    assert delayed == pytest.approx(solution.y[0], abs=1e-6)


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 10**6), lag_s=st.floats(0.01, 5000))
def test_live_equals_all_at_once(seed: int, lag_s: float) -> None:
    rng = np.random.default_rng(seed)
    time_s = np.cumsum(rng.exponential(5.0, 40) * rng.integers(0, 2, 40))
    values = rng.normal(25, 5, (40, 3))
    values[rng.random((40, 3)) < 0.2] = np.nan
    live = Lag(lag_s, 3)
    rows = [live.follow(time_s[i : i + 1], values[i : i + 1])[0] for i in range(40)]
    delayed = apply_lag(time_s, values, np.zeros(40, np.int64), lag_s)
    assert np.array_equal(rows, delayed, equal_nan=True)
    assert np.array_equal(np.isnan(delayed), np.isnan(values))


def test_a_gap_is_bridged_straight() -> None:
    time_s, zeros = np.arange(5.0), np.zeros(5, np.int64)
    whole = apply_lag(time_s, np.arange(5.0)[:, None], zeros, 2.0)
    gappy = apply_lag(time_s, np.array([0.0, 1.0, np.nan, 3.0, 4.0])[:, None], zeros, 2.0)
    assert gappy[[0, 1, 3, 4]] == pytest.approx(whole[[0, 1, 3, 4]], abs=1e-12)


def test_without_times_nothing_is_delayed_by_a_known_amount() -> None:
    times = np.full(5, np.nan)
    assert np.isnan(apply_lag(times, np.ones((5, 1)), np.zeros(5, np.int64), 2.0)).all()


def test_runs_do_not_touch_each_other_and_order_does_not_matter() -> None:
    rng = np.random.default_rng(1)
    series = np.repeat([7, 2], 20)
    time_s = np.tile(np.cumsum(rng.exponential(10, 20)), 2)
    values = rng.normal(20, 3, (40, 1))
    shuffled = rng.permutation(40)
    delayed = apply_lag(time_s, values, series, 33.0)
    again = apply_lag(time_s[shuffled], values[shuffled], series[shuffled], 33.0)
    assert np.array_equal(again, delayed[shuffled])
    alone = apply_lag(time_s[20:], values[20:], series[20:], 33.0)
    assert np.array_equal(delayed[20:], alone)

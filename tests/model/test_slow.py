"""Slow factors instant by instant against plain arrays over all instants at once."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armd.compensation.kernel.slow_factors import SlowFactors
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values
from armd.compensation.model.slow_factors import (
    After,
    Daily,
    Relaxation,
    SlowFactor,
    Temperature,
    TemperatureRate,
    Time,
)
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term

REFERENCE_C, BEGIN_S, MORE_C = 20.0, 1.7e9, 0.01
ARM = Arm.model_validate(
    {
        "schema": "armd.arm/1",
        "serial_number": "TEST",
        "temperature_sensor": [{"name": f"t{k}"} for k in range(1, 4)],
        "joint": [{"d_mm": 100.0}] * 3,
        "tip": {"offset_mm": [0.0, 0.0, 100.0]},
    }
)

weights = st.dictionaries(
    st.sampled_from(ARM.sensors), st.sampled_from([0.0, 0.25, 1.0, -1.0]), min_size=1
)
lags = st.sampled_from([0.0, 0.5, 40.0])
degrees = st.floats(10, 30)
seconds = st.floats(BEGIN_S - 100, BEGIN_S + 200)
#: Some end between the instants that are tried, some never.
periods = st.builds(
    lambda since, span: {
        "since_unix_s": st.just(since),
        "until_unix_s": st.just(None if span is None else since + span),
    },
    seconds,
    st.none() | st.floats(0, 100),
)
factors: st.SearchStrategy[SlowFactor] = st.one_of(
    st.builds(
        Temperature,
        weights=weights,
        order=st.integers(1, 4),
        lag_s=lags,
        reference_c=st.none() | degrees,
        zone_c=st.none() | st.tuples(degrees, degrees),
    ),
    st.builds(TemperatureRate, weights=weights, smoothing_s=st.sampled_from([0.5, 40.0])),
    periods.flatmap(lambda period: st.builds(Time, **period, power=st.integers(1, 3))),
    periods.flatmap(
        lambda period: st.builds(Relaxation, **period, time_constant_s=st.sampled_from([0.5, 40.0]))
    ),
    periods.flatmap(
        lambda period: st.builds(Daily, **period, kind=st.sampled_from(["daily_sin", "daily_cos"]))
    ),
    st.builds(After, instant_unix_s=seconds),
)
terms = st.lists(
    st.builds(Term, parameter=st.just("a_1"), basis=st.lists(factors, max_size=3)), max_size=5
)
temperatures = st.lists(st.floats(10, 30) | st.just(np.nan), min_size=3, max_size=3)
steps = st.lists(
    st.tuples(temperatures, st.sampled_from([0.0, 0.5, 7.0, np.nan])), min_size=1, max_size=8
)


def states_of(celsius: np.ndarray, time_s: np.ndarray, series: np.ndarray) -> States:
    nothing = np.zeros((len(celsius), 3))
    return States(nothing, nothing, celsius, time_s, nothing, series)


def expected(terms: list[Term], states: States) -> np.ndarray:
    return compute_basis_values(terms, states, ARM, REFERENCE_C, ARM.nominal())


@settings(deadline=None)
@given(terms=terms, steps=steps)
def test_an_instant_at_a_time_equals_all_at_once(
    terms: list[Term], steps: list[tuple[list[float], float]]
) -> None:
    celsius = np.array([reading for reading, _ in steps])
    step_s = np.array([step for _, step in steps])
    # Missing times stand last, where sorting in time puts them.
    time_s = BEGIN_S + np.sort(np.cumsum(np.nan_to_num(step_s)) + 0 * step_s)
    slow, again = (SlowFactors(terms, ARM, REFERENCE_C) for _ in range(2))
    live = [slow.values(*instant)[0] for instant in zip(celsius, time_s, strict=True)]
    whole = expected(terms, states_of(celsius, time_s, np.zeros(len(steps), np.int64)))
    assert np.array(live) == pytest.approx(whole, rel=1e-9, abs=1e-9, nan_ok=True)

    half = len(steps) // 2  # the same lags, followed through many instants and one by one
    first = states_of(celsius[:half], time_s[:half], np.zeros(half, np.int64))
    compute_basis_values(terms, first, ARM, REFERENCE_C, ARM.nominal(), again.delay)
    for i in range(half, len(steps)):
        values, _ = again.values(celsius[i], time_s[i])
        assert values == pytest.approx(live[i], rel=1e-9, abs=1e-9, nan_ok=True)


@settings(deadline=None)
@given(terms=terms, reading=temperatures, time_s=seconds | st.just(np.nan))
def test_a_sensor_that_reads_more(terms: list[Term], reading: list[float], time_s: float) -> None:
    slow, celsius = SlowFactors(terms, ARM, REFERENCE_C), np.array(reading)
    slow.values(celsius - 1.0, time_s - 10.0)  # changes know nothing of lags
    _, changes = slow.values(celsius, time_s, MORE_C)
    each = np.vstack([celsius, celsius + MORE_C * np.eye(3)])
    settled = expected(terms, states_of(each, np.full(4, time_s), np.arange(4)))
    assert changes == pytest.approx(settled[1:] - settled[0], rel=1e-6, abs=1e-8, nan_ok=True)


def test_a_new_start_is_settled() -> None:
    lagging = Temperature(weights={"t1": 1.0}, lag_s=40.0)
    slow = SlowFactors([Term(parameter="a_1", basis=[lagging])], ARM, REFERENCE_C)
    slow.values(np.full(3, 20.0), 0.0)
    assert slow.values(np.full(3, 30.0), 1.0)[0] < 1.0
    slow.forget()
    assert slow.values(np.full(3, 30.0), 2.0)[0] == 10.0

"""What a link's temperature can do, against a link that cools by Newton's law."""

from __future__ import annotations

import math

import numpy as np
import pytest

from armd.compensation.data.soundness.heat_flow import LiveSensor, SensorHeat

TIME_S = 20.0 * np.arange(160)


def link(time_s: np.ndarray, air_c: np.ndarray, tau_s: float, start_c: float) -> np.ndarray:
    """Readings of a link in air that is the same from one reading to the next."""
    celsius = [start_c]
    for step, air in zip(np.diff(time_s), air_c[1:], strict=True):
        celsius.append(air + (celsius[-1] - air) * math.exp(-step / tau_s))
    return np.array(celsius)


def steady() -> np.ndarray:
    return 27.0 + 0.05 * np.random.default_rng(3).normal(size=len(TIME_S))


@pytest.mark.parametrize("power_on_c", [85.0, -40.0, 0.0, 127.9375])
@pytest.mark.parametrize(
    "rows", [[0], [76], [159], [0, 1, 2], [4, 23, 41, 66, 90, 107, 131, 152], [60, 61, 62, 63]]
)
def test_power_on_values_are_no_temperatures(power_on_c: float, rows: list[int]) -> None:
    celsius = steady()
    celsius[rows] = power_on_c
    bad = SensorHeat(20.0).impossible(celsius, TIME_S)
    assert np.flatnonzero(bad).tolist() == rows


def test_values_of_several_kinds_beside_missing_ones() -> None:
    celsius = steady()
    celsius[[10, 50, 51]] = 85.0, -40.0, 127.0
    celsius[20:40] = np.nan
    bad = SensorHeat(20.0).impossible(celsius, TIME_S)
    assert np.flatnonzero(bad).tolist() == [10, 50, 51]


@pytest.mark.parametrize("tau_s", [120.0, 600.0])
def test_a_link_that_is_carried_in_and_out_of_a_chamber_is_believed(tau_s: float) -> None:
    """15 K between indoors and outdoors every half an hour, and a heater of 35 K for 5 min."""
    air_c = np.where((TIME_S // 1800) % 2 == 0, 22.0, 7.0) + 35.0 * ((TIME_S // 300) == 4)
    celsius = link(TIME_S, air_c, tau_s, 22.0)
    assert not SensorHeat(20.0).impossible(celsius, TIME_S).any()
    live = LiveSensor(20.0)
    assert all(live.believe(c, t) for c, t in zip(celsius, TIME_S, strict=True))


def test_of_readings_without_times_only_what_no_surroundings_give_is_refused() -> None:
    celsius = steady()
    celsius[40] = 60.0
    unknown = np.full(len(celsius), np.nan)
    assert not SensorHeat(20.0).impossible(celsius, unknown).any()
    celsius[40] = 85.0
    assert np.flatnonzero(SensorHeat(20.0).impossible(celsius, unknown)).tolist() == [40]


def test_rows_in_any_order_are_compared_by_the_time_between_them() -> None:
    ramp = 15.0 + 15.0 * TIME_S / TIME_S[-1]
    order = np.random.default_rng(5).permutation(len(ramp))
    assert not SensorHeat(20.0).impossible(ramp[order], TIME_S[order]).any()


@pytest.mark.parametrize("piece", [1, 7, 64])
def test_pieces_give_what_the_whole_gives(piece: int) -> None:
    celsius = steady()
    celsius[[30, 31, 70, 127, 128]] = 85.0
    heat = SensorHeat(20.0)
    pieces = [
        heat.impossible(celsius[i : i + piece], TIME_S[i : i + piece])
        for i in range(0, len(celsius), piece)
    ]
    whole = SensorHeat(20.0).impossible(celsius, TIME_S)
    np.testing.assert_array_equal(np.concatenate(pieces), whole)


def test_a_loose_plug_is_no_channel() -> None:
    """More than a tenth is missing then, which drops a channel."""
    rng = np.random.default_rng(1)
    n = 5_000
    celsius = np.where(rng.uniform(size=n) < 0.3, rng.uniform(-50.0, 140.0, n), 22.0)
    bad = SensorHeat(20.0).impossible(celsius, 20.0 * np.arange(n))
    assert bad.mean() > 0.1


def live(readings: list[tuple[float, float]]) -> list[bool]:
    sensor = LiveSensor(20.0)
    return [sensor.believe(celsius, time_s) for time_s, celsius in readings]


def test_live_the_first_value_may_be_the_power_on_value() -> None:
    assert live([(0.0, 85.0), (0.5, 27.0), (1.0, 27.1)]) == [False, True, True]
    assert live([(0.0, 0.0), (0.5, 27.0), (1.0, 27.1)]) == [True, True, True]


def test_live_a_value_that_returns_is_not_believed() -> None:
    readings = [(k / 2, 85.0 if k in (20, 21, 50) else 27.0) for k in range(80)]
    assert [k for k, believed in enumerate(live(readings)) if not believed] == [20, 21, 50]


def test_live_a_step_that_stays_is_believed_after_five_seconds() -> None:
    """The sensor may have been fastened elsewhere; what no surroundings give never is."""
    step = [(k / 2, 20.0 if k < 40 else 45.0) for k in range(80)]
    assert [k for k, believed in enumerate(live(step)) if not believed] == list(range(40, 50))
    far = [(k / 2, 20.0 if k < 40 else 85.0) for k in range(400)]
    assert not any(live(far)[40:])


def test_live_a_hot_motor_at_the_start_is_believed_after_five_seconds() -> None:
    assert live([(k / 2, 65.0) for k in range(12)]) == [False] * 10 + [True] * 2

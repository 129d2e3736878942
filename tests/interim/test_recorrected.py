"""Measurements under another calibration, against the plain chain; and what is said of each."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from armd import Flag
from armd.compensation.interim.recorrection.recorrect import correct_again
from armd.compensation.model.slow_factors import Temperature, Time
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term
from support.plain_kinematics import tip_pose
from support.readings import states_of
from support.small_arm import small_arm, thermal_calibration

ARM = small_arm()
NAMES = ARM.layout.names
NOON = 1.77e9


def states(celsius: list[list[float]], q: np.ndarray | None = None) -> States:
    """One measurement for each row of temperatures of a, b, c; an hour apart."""
    n = len(celsius)
    angles = np.random.default_rng(1).uniform(-2.0, 2.0, (n, 3)) if q is None else q
    time_s = NOON + 3600.0 * np.arange(n)
    return states_of(angles, temperature_c=np.array(celsius), time_s=time_s)


def plain_tips(at: States, off: dict[str, np.ndarray]) -> np.ndarray:
    p = np.tile(thermal_calibration(ARM).content.vector(3), (at.n, 1))
    for name, by in off.items():
        p[:, NAMES.index(name)] += by
    return tip_pose(at.q, p)[:, :3, 3]


def test_positions_are_the_plain_chains_at_each_ones_temperature() -> None:
    at = states([[20, 20, 20], [20, 26, 20], [20, 16, 29]])
    found = correct_again(ARM, thermal_calibration(ARM), at)
    grown = plain_tips(at, {"a_2": 0.01 * (at.temperature_c[:, 1] - 20.0)})
    assert found.position_mm == pytest.approx(grown, abs=1e-9)
    assert np.linalg.norm(grown - plain_tips(at, {}), axis=1) == pytest.approx([0.0, 0.06, 0.04])
    assert not found.flags.any()


def test_what_a_temperature_says_of_its_measurement() -> None:
    """Sensor b is used, a has a range but no term, c is none of the model's."""
    nan = float("nan")
    at = states([[20, 31, 20], [20, 14.9, 20], [20, nan, 20], [20, 20, nan], [20, 20, 99]])
    flags = correct_again(ARM, thermal_calibration(ARM), at).flags
    outside, unknown = int(Flag.TEMPERATURE_RANGE), int(Flag.INVALID | Flag.TEMPERATURE_STALE)
    assert flags.tolist() == [outside, outside, unknown, 0, 0]


def test_a_measurement_without_an_angle_has_no_position() -> None:
    q = np.array([[0.1, 0.2, 0.3], [0.1, np.nan, 0.3]])
    found = correct_again(ARM, thermal_calibration(ARM), states([[20, 20, 20]] * 2, q))
    assert np.isfinite(found.position_mm[0]).all() and np.isnan(found.position_mm[1]).all()
    assert found.flags.tolist() == [0, int(Flag.INVALID)]
    assert np.isnan(found.uncertainty_mm[1]).all()


@pytest.mark.slow
def test_beyond_its_time_a_term_is_held_and_that_is_said() -> None:
    since, until = NOON + 1800.0, NOON + 3600.0 + 1800.0  # around the second of three
    growing: dict[str, Any] = {"since_unix_s": since, "until_unix_s": until}
    terms = [
        Term(parameter="a_2", basis=[Temperature(weights={"b": 1.0})], coefficient=0.01),
        Term(parameter="a_3", basis=[Time(**growing)], coefficient=0.01),  # mm/h
    ]
    at = states([[20, 20, 20]] * 3)
    found = correct_again(ARM, thermal_calibration(ARM, terms=terms), at)
    hours = np.array([0.0, 0.5, 1.0])  # held at both ends
    expected = plain_tips(at, {"a_3": 0.01 * hours})
    assert found.position_mm == pytest.approx(expected, abs=1e-9)
    assert found.flags.tolist() == [int(Flag.TEMPERATURE_RANGE), 0, int(Flag.TEMPERATURE_RANGE)]


@pytest.mark.slow
def test_its_uncertainty_is_the_covariance_moved_to_the_tip() -> None:
    known = {"covariance_of": ["a_2", "term 0"], "covariance": [[4e-4, 1e-6], [1e-6, 9e-6]]}
    at = states([[20, 20, 20], [20, 26, 20]])
    found = correct_again(ARM, thermal_calibration(ARM, **known), at).uncertainty_mm
    h = 1e-4
    along = (plain_tips(at, {"a_2": h}) - plain_tips(at, {"a_2": -h})) / (2.0 * h)
    warmth = at.temperature_c[:, 1] - 20.0
    variance = 4e-4 + 2.0 * 1e-6 * warmth + 9e-6 * warmth**2
    assert found == pytest.approx(np.abs(along) * np.sqrt(variance)[:, None], rel=1e-3, abs=1e-7)

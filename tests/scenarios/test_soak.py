"""The slope of memory that `make soak` prints, on series whose slope is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from soak import slope_per_hour, what_is_bad

SECONDS = np.arange(3600.0)


def test_the_slope_is_found_within_its_uncertainty() -> None:
    """Deviations in standard uncertainties are Student's of 8 degrees of freedom: 1.15 wide."""
    rng = np.random.default_rng(5)
    off = []
    for _ in range(400):
        slope, uncertainty = slope_per_hour(
            SECONDS, 76 + 3 * SECONDS / 3600 + rng.normal(0, 0.2, SECONDS.size)
        )
        off.append((slope - 3) / uncertainty)
    assert abs(np.mean(off)) < 0.2
    assert 1.0 < np.std(off) < 1.35


def test_one_step_is_no_certain_slope_and_too_few_are_none() -> None:
    slope, uncertainty = slope_per_hour(SECONDS, np.where(SECONDS > 1800, 77.0, 76.0))
    assert slope == pytest.approx(1.5, rel=0.02) and uncertainty > 0.2
    assert all(math.isnan(x) for x in slope_per_hour(SECONDS[:19], SECONDS[:19]))


GOOD = {
    "wrong": 0,
    "unexplained": 0,
    "recorder_exit_code": 0,
    "daemon_exit_code": 0,
    "delivered": 7,
    "recorded": 7,
}


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({}, []),
        ({"wrong": 2}, ["wrong is 2, expected 0"]),
        ({"daemon_exit_code": -9}, ["daemon_exit_code is -9, expected 0"]),
        ({"recorded": 9}, ["9 points recorded, 7 delivered"]),
        ({"recorded": 0, "delivered": 0}, ["no point was delivered"]),
    ],
)
def test_a_bad_run_says_what_is_bad(other: dict[str, int], said: list[str]) -> None:
    assert what_is_bad(GOOD | other) == said

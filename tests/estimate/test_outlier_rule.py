"""The rule of outliers that docs/how-to/calibrate.md states, by what the code does."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.stats import chi2

from armd.arrays import F64
from armd.compensation.estimate.noise.robust import compute_redescending_weights, select_outliers
from support.pages import page_path

TEXT = page_path("calibrate").read_text(encoding="utf-8")
N_READINGS = 400


def stated(pattern: str) -> float:
    (number,) = re.findall(pattern, TEXT)
    return float(number.replace(",", ""))


def normal_distance2() -> F64:
    """Of readings with normal noise, without chance: the quantiles of their distances."""
    return chi2.ppf((np.arange(N_READINGS) + 0.5) / N_READINGS, 3)


def n_named(n_far: int, distance: float) -> tuple[int, float]:
    """Outliers among normal readings of which *n_far* lie at a distance (σ); the smallest p."""
    distance2 = normal_distance2()
    distance2[-n_far:] = distance**2
    named, p = select_outliers(distance2, np.zeros(N_READINGS, bool))
    return len(named), p


def test_a_reading_is_down_weighted_from_the_distance_on_that_the_page_states() -> None:
    sigma = stated(r"farther off than ([\d.]+) σ")
    one_in = stated(r"one Gaussian reading in ([\d,]+)\)")
    assert chi2.sf(sigma**2, 3) == pytest.approx(1 / one_in, rel=0.1)
    near, far = compute_redescending_weights(
        np.array([sigma - 0.05, sigma + 0.05]) ** 2, np.zeros(2, bool)
    )
    assert near == 1.0 > far
    (of_region,) = compute_redescending_weights(np.array([4 * sigma**2]), np.ones(1, bool))
    assert of_region == 1.0


def test_an_outlier_is_less_probable_than_the_page_states() -> None:
    below = stated(r"with a probability below ([\d.]+) among all readings")
    count, p = n_named(1, 20.0)
    assert count == 1 and p < below
    named = [n_named(1, distance) for distance in np.linspace(4.0, 9.0, 400)]
    p_of_named = [p for count, p in named if count]
    assert 0.8 * below < max(p_of_named) < below
    assert not all(count for count, _ in named)


def test_more_than_the_share_that_the_page_states_are_no_outliers() -> None:
    most = round(stated(r"over (\d+) % are so far off") / 100 * N_READINGS)
    assert [n_named(n, 30.0)[0] for n in (1, most, most + 1)] == [1, most, 0]

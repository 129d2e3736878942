"""Single rests against tails: found where no tail explains them, never in tails alone."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import fdtri
from small_fit import unit_noise

from armd.compensation.diagnose.fitting import outliers
from armd.compensation.diagnose.fitting.outliers import find_outliers

N = 400


def found_in(left: np.ndarray) -> tuple[list[int], float]:
    n = len(left)
    fit: Any = SimpleNamespace(
        linear=SimpleNamespace(rests=SimpleNamespace(n=n)),
        raw_residual=left.ravel(),
        fitted=np.zeros(3 * n),
        noise=unit_noise(n),
    )
    rests, p = find_outliers(fit)
    return rests.tolist(), p


def test_one_reading_far_off_is_found_and_a_group_of_one_kind_too() -> None:
    left = np.random.default_rng(1).normal(size=(N, 3))
    left[7] = [0.0, 9.0, 0.0]
    rests, p = found_in(left)
    assert rests == [7] and p < 1e-5
    group = [3, 50, 51, 90, 200, 301]
    left = np.random.default_rng(2).normal(size=(N, 3))
    left[group] = 40.0
    assert found_in(left)[0] == group


@pytest.mark.parametrize("freedom", [3.0, 4.0, 6.0, np.inf])
def test_tails_alone_hold_no_outlier(freedom: float) -> None:
    """In hundred data sets, at most a few; one in a thousand is promised each look."""
    rng = np.random.default_rng(3)
    alarms = 0
    for _ in range(100):
        left = rng.normal(size=(N, 3))
        if np.isfinite(freedom):
            left /= np.sqrt(rng.chisquare(freedom, (N, 1)) / freedom)
        alarms += bool(found_in(left)[0])
    assert alarms <= 2


def test_more_than_a_few_are_no_single_readings() -> None:
    left = np.random.default_rng(4).normal(size=(N, 3))
    left[: N // 10] = 50.0
    assert found_in(left) == ([], 1.0)


@pytest.mark.parametrize("freedom", [2.5, 5.0, 12.0])
def test_the_tails_are_told_by_two_quantiles(freedom: float) -> None:
    ratio = fdtri(3, freedom, outliers.EDGE) / fdtri(3, freedom, outliers.MIDDLE)
    assert outliers._freedom(ratio) == pytest.approx(freedom, rel=1e-6)

"""Single rests against tails: found where no tail explains them, never in tails alone."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import fdtri

from armd.compensation.diagnose.fitting.outliers import find_outliers
from armd.compensation.estimate import robust
from armd.compensation.estimate.folds import blocks_of_time, whole_groups
from support.selection import parametrize_default
from support.small_fit import unit_noise

N = 400


def found_in(left: np.ndarray) -> tuple[list[int], float]:
    """Of rests all over the turn of six joints, as many as residuals (n, 3)."""
    n = len(left)
    states = SimpleNamespace(q=np.random.default_rng(n).uniform(-3.0, 3.0, (n, 6)))
    rests = SimpleNamespace(n=n, observations=SimpleNamespace(states=states))
    fit: Any = SimpleNamespace(
        linear=SimpleNamespace(rests=rests),
        left_mm=left,
        noise=unit_noise(n),
    )
    found, p = find_outliers(fit)
    return found.tolist(), p


def test_one_reading_far_off_is_found_and_a_group_of_one_kind_too() -> None:
    left = np.random.default_rng(1).normal(size=(N, 3))
    left[7] = [0.0, 9.0, 0.0]
    rests, p = found_in(left)
    assert rests == [7] and p < 1e-5
    group = [3, 50, 51, 90, 200, 301]
    left = np.random.default_rng(2).normal(size=(N, 3))
    left[group] = 40.0
    assert found_in(left)[0] == group


@parametrize_default("freedom", [3.0, 4.0, 6.0, np.inf])
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
    ratio = fdtri(3, freedom, robust.EDGE) / fdtri(3, freedom, robust.MIDDLE)
    assert robust._freedom(ratio) == pytest.approx(freedom, rel=1e-6)


def test_a_normal_reading_is_let_go_once_in_ten_thousand_and_clipped_once_in_eighty() -> None:
    square = np.random.default_rng(5).chisquare(3, 2_000_000)
    weight = robust.redescending_weights(square, np.zeros(len(square), dtype=bool))
    assert (weight < 1.0).mean() == pytest.approx(1e-4, rel=0.25)
    assert (robust.huber_weights(np.sqrt(square)) < 1.0).mean() == pytest.approx(1 / 80, rel=0.05)
    assert np.median(square) == pytest.approx(robust.MEDIAN_D2, rel=0.01)


def test_the_pull_of_a_reading_far_off_falls_or_stays_and_a_region_counts_fully() -> None:
    far = np.array([10.0, 20.0, 1000.0])
    falling = robust.redescending_weights(far**2, np.array([False, False, True]))
    assert falling[0] * 10.0 == pytest.approx(2 * falling[1] * 20.0) and falling[2] == 1.0
    np.testing.assert_allclose(robust.huber_weights(far) * far, robust.WINSOR_AT)
    # Where the loss rises by the pull, reweighted squares have its minimum.
    step = 1e-6
    slope = (robust.huber_loss(far[:1] + step) - robust.huber_loss(far[:1] - step)) / (2 * step)
    assert slope == pytest.approx(robust.WINSOR_AT)


def test_whole_groups_are_left_out_together_and_times_one_after_another() -> None:
    labels = np.array([7, 7, 3, 9, 9, 3, 11])
    folds = whole_groups(labels, 3)
    assert folds.tolist() == [1, 1, 0, 2, 2, 0, 0]
    assert not whole_groups(np.full(4, 5), 8).any() and len(whole_groups(labels[:0], 8)) == 0
    time_s = np.array([5.0, 1.0, 2.0, 9.0, 3.0, 4.0])
    assert blocks_of_time(time_s, 3).tolist() == [2, 0, 0, 2, 1, 1]

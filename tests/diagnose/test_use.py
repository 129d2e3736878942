"""How warm a joint is of its own use, where that is known in closed form."""

import numpy as np
import pytest

from armd.compensation.diagnose.problem.use import evaluate_histories
from armd.compensation.effects.effect import Use, Winding
from armd.compensation.model.state import States
from support.readings import states_of

TAU_S = 300.0


def states(time_s: np.ndarray, q: np.ndarray, rate: np.ndarray, series: np.ndarray) -> States:
    angles = np.stack([np.zeros(len(q)), q], axis=1)
    rates = np.stack([np.full(len(q), np.nan), rate], axis=1)
    return states_of(angles, rate=rates, time_s=time_s, series=series)


@pytest.mark.parametrize("by_rate", [True, False])
def test_steady_use_warms_towards_its_rate_and_a_session_begins_cold(by_rate: bool) -> None:
    """At half a radian a second; the rows in any order."""
    since_s = np.concatenate([20.0 * np.arange(40), 35.0 * np.arange(25)])
    series = np.repeat([0, 1], [40, 25])
    time_s = since_s + 1e5 * series
    order = np.random.default_rng(2).permutation(len(time_s))
    whole = states(time_s, -0.5 * time_s, np.full(len(time_s), -0.5), series)
    found = evaluate_histories([Use(2, by_rate, TAU_S, ())], whole.rows(order))[0]
    assert found == pytest.approx(0.5 * (1 - np.exp(-since_s / TAU_S))[order], abs=1e-12)


def test_rest_cools_it() -> None:
    time_s = np.array([0.0, 1e4, 1e4 + TAU_S, 1e4 + 3 * TAU_S])
    q = np.array([0.0, 2e4, 2e4, 2e4])
    still = states(time_s, q, np.full(4, np.nan), np.zeros(4, dtype=np.int64))
    (found,) = evaluate_histories([Use(2, False, TAU_S, ())], still)
    assert found == pytest.approx([0.0, 2.0, 2.0 * np.exp(-1), 2.0 * np.exp(-3)])
    assert not evaluate_histories([Use(2, True, TAU_S, ())], still).any(), (
        "a missing rate is no use"
    )


def test_a_joint_is_wound_up_as_far_as_it_goes_and_back_at_once() -> None:
    """Up to 0.2 rad; the rows in any order, and each session begins unwound."""
    q = np.array([0.5, 0.6, 1.5, 1.4, 1.2, 0.2, 3.0, 2.9])
    of_rows = np.array([0.0, 0.5, 1.0, 0.5, -0.5, -1.0, 0.0, -0.5])
    time_s, series = 10.0 * np.arange(8), np.repeat([0, 1], [6, 2])
    order = np.random.default_rng(2).permutation(8)
    whole = states(time_s, q, np.full(8, np.nan), series)
    found = evaluate_histories([Winding(2, 0.2, ())], whole.rows(order))[0]
    assert found == pytest.approx(of_rows[order], abs=1e-12)


def test_many_at_once_are_each_as_alone() -> None:
    random = np.random.default_rng(3)
    time_s, series = np.sort(random.uniform(0, 1e4, 60)), np.repeat([0, 1, 2], 20)
    whole = states(time_s, random.normal(0, 1, 60), random.normal(0, 1, 60), series)
    all_of_them = [
        Winding(2, 0.2, ()), Use(2, True, 30.0, ()), Winding(1, 1.0, ()), Use(2, False, 300.0, ()),
    ]  # fmt: skip
    alone = [evaluate_histories([each], whole)[0] for each in all_of_them]
    np.testing.assert_array_equal(evaluate_histories(all_of_them, whole), alone)
    assert [each.any() for each in alone] == [True, True, False, True]  # joint 1 stands still

"""What a drift may stray is a random walk, what a lag begins with fades: against plain algebra."""

import itertools
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.heldout.later_readings import split_in_time
from armd.compensation.diagnose.problem.whitening import RestNoise
from armd.compensation.diagnose.scoring import time_discrepancy
from armd.compensation.diagnose.scoring.evidence import compute_log_bayes_factors
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column
from armd.compensation.model.basis import compute_basis_values
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from support import synthetic

NO_NOISE = RestNoise(0.0, 0.5, 0.0, 0.0, 0.0, np.zeros((0, 3, 3)), np.zeros(0))


def test_the_principal_functions_make_a_random_walk() -> None:
    """Covariance min(s, t), but for the 1/(π² m) that the functions left out would add."""
    time_s = np.sort(np.random.default_rng(1).uniform(5e3, 9e3, 900))
    functions = time_discrepancy._principal(time_s)
    since = (time_s - time_s[0]) / np.ptp(time_s)
    walk = np.minimum(since[:, None], since[None, :])
    missing = walk - functions @ functions.T
    assert np.diag(missing).mean() == pytest.approx(
        1.0 / (np.pi**2 * time_discrepancy.MOST_FUNCTIONS), rel=0.15
    )
    assert np.abs(missing).max() < 0.05


def test_a_walks_own_wandering_is_taken_up_and_a_step_at_once_is_not() -> None:
    rng = np.random.default_rng(2)
    time_s = np.arange(800.0)
    functions = time_discrepancy._principal(time_s)
    walks = np.cumsum(rng.normal(size=(800, 100)), axis=0) / np.sqrt(800.0)
    left = walks - functions @ np.linalg.lstsq(functions, walks, rcond=None)[0]
    assert np.mean(left**2) < 0.012 < 0.4 < np.mean(walks**2)
    step = np.where(time_s >= 400.0, 1.0, 0.0)
    left = step - functions @ np.linalg.lstsq(functions, step, rcond=None)[0]
    assert np.abs(left[390:410]).max() > 0.3


def test_a_bayes_factor_is_as_rare_under_no_effect_as_markov_says() -> None:
    rng = np.random.default_rng(3)
    columns = rng.normal(size=(60, 15))
    gram = columns.T @ columns
    side = rng.normal(size=(4000, 60)) @ columns
    ones = np.ones((1, 15))
    logs = compute_log_bayes_factors(np.tile(gram, (4000, 1, 1)), side, 0.2 * ones, 10.0 * ones)
    for factor in (3.0, 10.0, 30.0):
        assert np.mean(logs >= np.log(factor)) <= 1.0 / factor


def test_parts_of_the_time_are_whole_placements_in_their_order() -> None:
    placement = np.repeat([3, 0, 1, 2, 7], 6)
    states = SimpleNamespace(time_s=np.arange(30.0))
    observations: Any = SimpleNamespace(placement=placement, states=states)
    parts = split_in_time(observations)
    assert [set(parts[placement == p]) for p in (3, 0, 1, 2, 7)] == [{0}, {0}, {1}, {2}, {3}]
    alone: Any = SimpleNamespace(
        placement=np.zeros(8, dtype=np.int64),
        states=SimpleNamespace(time_s=np.array([7.0, 6, 5, 4, 3, 2, 1, 0])),
    )
    assert split_in_time(alone).tolist() == [3, 3, 2, 2, 1, 1, 0, 0]


def test_each_length_of_a_late_link_may_be_late_by_its_own() -> None:
    """Two lengths on a ramp, one moved by two terms against each other: a lateness other than the
    link's by a third in one of them is taken up whole, and costs one standard deviation. What fades
    moves them as the lateness does, as far at first as it goes."""
    arm = synthetic.arm()
    n, lag_s = 50, 600.0
    time_s = 60.0 * np.arange(n)
    temperature_c = np.repeat(20.0 + time_s[:, None] / 180.0, 6, axis=1)
    states = synthetic.session(arm, arm.nominal(), np.random.default_rng(1), readings=n).states
    states = replace(states, time_s=time_s, temperature_c=temperature_c)
    now = Temperature(weights={"t2": 1.0})
    late = now.model_copy(update={"lag_s": lag_s})
    terms = tuple(
        Term(parameter=name, basis=[factor], coefficient=sign * mm)
        for name, mm in (("d_2", 0.002), ("a_2", -0.001), ("a_2", 0.005))
        for factor, sign in ((late, 1.0), (now, -1.0))
    )
    lag = Candidate(
        "thermal_lag",
        location.link(2),
        (Column("share", "1", 1.0, terms),),
        ("t2", "time_s"),
        (("time constant", lag_s, "s"),),
    )
    model = SimpleNamespace(reference_c=20.0, constants=arm.nominal())
    observations = SimpleNamespace(states=states, session=np.arange(n) // 25)
    linear: Any = SimpleNamespace(
        rests=SimpleNamespace(observations=observations),
        model=model,
        residual=np.zeros(3 * n),
        signature=lambda at, values: np.kron(values, np.eye(3)[at % 3]),
    )
    exact = replace(NO_NOISE, whitener=np.tile(1e9 * np.eye(3), (n, 1, 1)))
    columns = time_discrepancy.make_time_discrepancy_columns(
        linear, exact, lag, np.array([1.5]), arm
    )
    assert columns.shape == (3 * n, 2 + 2 * 2)  # each length; two fadings in each session
    rise = temperature_c[:, 0] - 20.0
    behind = lagged(time_s, rise, lag_s) - rise
    for column, name, mm in zip(columns.T, ("d_2", "a_2"), (0.002, 0.004), strict=False):
        own = column.reshape(n, 3)[:, arm.layout.index(name) % 3]
        np.testing.assert_allclose(
            own, time_discrepancy.OF_A_LENGTH * 1.5 * mm * behind, atol=2e-4 * mm
        )
        first = columns[:, 2].reshape(n, 3)[:, arm.layout.index(name) % 3]
        faded = np.exp(-time_s / lag_s) * (np.arange(n) < 25)
        most = 1.5 * mm * np.abs(behind).max()
        np.testing.assert_allclose(first, most * faded, atol=2e-4 * mm)
    fading = time_discrepancy.make_initial_state_candidate(linear, lag, np.array([1.5]), arm)
    for own, known in zip(fading.columns, columns.T[2:], strict=True):
        values = compute_basis_values(own.terms, states, arm, model.reference_c, model.constants)
        moved = np.zeros(3 * n)
        for term, value in zip(own.terms, values.T, strict=True):
            moved += linear.signature(arm.layout.index(term.parameter), term.coefficient * value)
        np.testing.assert_allclose(moved, known, atol=1e-12)
    coarse = replace(NO_NOISE, whitener=np.tile(1e-9 * np.eye(3), (n, 1, 1)))
    assert time_discrepancy.make_time_discrepancy_columns(
        linear, coarse, lag, np.array([1.5]), arm
    ).shape == (
        3 * n,
        0,
    )


def lagged(time_s: np.ndarray, values: np.ndarray, lag_s: float) -> np.ndarray:
    """A first-order lag that begins settled, driven by straight lines between the readings."""
    found = [values[0]]
    for step, (before, after) in zip(np.diff(time_s), itertools.pairwise(values), strict=True):
        keep, slope = np.exp(-step / lag_s), (after - before) / step
        settled = after - slope * lag_s
        found.append(settled + keep * (found[-1] - (before - slope * lag_s)))
    return np.array(found)

"""Candidates' columns two ways, rows and products, against their terms one by one; instants."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.constants import MOST_INSTANTS
from armd.compensation.diagnose.problem.session_facts import _grid as grid
from armd.compensation.diagnose.problem.session_facts import _moments as moments
from armd.compensation.diagnose.problem.session_facts import _span as span
from armd.compensation.diagnose.problem.signatures import compile_candidates
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, tie
from armd.compensation.effects.encoder.encoder_eccentricity import make_harmonic_columns
from armd.compensation.model.parameters import ParameterLayout
from armd.compensation.model.pose_factors import Angle, Harmonic

N, JOINTS = 30, 6
WAVE = Harmonic(kind="sin", joint=2, order=1)
CANDIDATES = [
    Candidate("encoder_eccentricity", location.joint(2), make_harmonic_columns(2, 1, 1.0), ("q2",)),
    Candidate(
        "axis_wobble",
        location.joint(4),
        (Column("tilt", "rad", 2.0, tie([("alpha_3", 0.5), ("theta_4", -2.0)], WAVE)),),
        ("q2",),
    ),
    Candidate(
        "unknown",
        location.parameter(5, "d_5(q1)"),
        (Column("d", "mm", 1.0, tie([("d_5", 1.0)], Angle(joint=1, power=2), WAVE), reach=5.0),),
        ("q1", "q2"),
    ),
]


@pytest.fixture
def compiled():
    rng = np.random.default_rng(1)
    layout = ParameterLayout(JOINTS)
    states = SimpleNamespace(n=N, q=rng.uniform(-3, 3, (N, JOINTS)))
    linear: Any = SimpleNamespace(
        rests=SimpleNamespace(n=N, observations=SimpleNamespace(states=states)),
        model=SimpleNamespace(reference_c=20.0, constants=np.zeros(layout.count)),
        residual=np.zeros(3 * N + 1),
        jacobian=rng.normal(size=(layout.count, 3 * N + 1)),
    )
    linear.jacobian[:, -1] = 0.0  # a length: no parameter of the arm moves it
    arm: Any = SimpleNamespace(layout=layout, sensors=[])
    return compile_candidates(CANDIDATES, linear, arm), linear, states.q


def one_by_one(linear: Any, q: np.ndarray) -> np.ndarray:
    """(K, N) each column by its definition: Σ weight × parameter's column × basis."""
    at = ParameterLayout(JOINTS).index
    sin, cos = np.repeat(np.sin(q[:, 1]), 3), np.repeat(np.cos(q[:, 1]), 3)
    j = linear.jacobian[:, : 3 * N]
    found = [
        j[at("theta_2")] * sin,
        j[at("theta_2")] * cos,
        0.5 * j[at("alpha_3")] * sin - 2.0 * j[at("theta_4")] * sin,
        j[at("d_5")] * np.repeat(q[:, 0] ** 2, 3) * sin,
    ]
    return np.hstack([np.array(found), np.zeros((4, 1))])


def test_rows_are_the_columns_by_their_definition(compiled) -> None:
    signatures, linear, q = compiled
    rows = signatures.rows(linear, np.arange(4))
    np.testing.assert_allclose(rows, one_by_one(linear, q), atol=1e-12)
    some = signatures.rows_of_terms(linear, linear.jacobian, np.array([2, 0]))
    np.testing.assert_allclose(some, one_by_one(linear, q)[[2, 0]], atol=1e-12)
    assert [list(signatures.columns_of(i)) for i in range(3)] == [[0, 1], [2], [3]]
    np.testing.assert_array_equal(signatures.prior_sd, [1.0, 1.0, 2.0, 1.0])
    np.testing.assert_array_equal(signatures.reach, [np.inf, np.inf, np.inf, 5.0])


def test_products_without_the_rows_are_products_with_them(compiled, monkeypatch) -> None:
    signatures, linear, q = compiled
    others = np.random.default_rng(2).normal(size=(N, 3, 5))
    jacobian = linear.jacobian[:, : 3 * N].reshape(-1, N, 3)
    expected = one_by_one(linear, q)[:, : 3 * N] @ others.reshape(3 * N, 5)
    np.testing.assert_allclose(signatures.products(jacobian, others, slice(None)), expected)
    monkeypatch.setattr("armd.compensation.diagnose.problem.signatures.SIGNATURES_PIECE", 7)
    np.testing.assert_allclose(signatures.products(jacobian, others, slice(None)), expected)
    some = np.array([3, 11, 4])
    rows = (3 * some[:, None] + np.arange(3)).ravel()
    expected = one_by_one(linear, q)[:, rows] @ others[some].reshape(9, 5)
    found = signatures.products(jacobian[:, some], others[some], some)
    np.testing.assert_allclose(found, expected)


@pytest.mark.parametrize("some", [slice(None), np.array([3, 11, 4])])
def test_products_within_candidates_are_those_of_their_columns(
    compiled, monkeypatch, some: slice | np.ndarray
) -> None:
    signatures, linear, q = compiled
    columns = one_by_one(linear, q)[:, : 3 * N].reshape(4, N, 3)[:, some].reshape(4, -1)
    jacobian = linear.jacobian[:, : 3 * N].reshape(-1, N, 3)[:, some]
    monkeypatch.setattr("armd.compensation.diagnose.problem.pairs.PAIRS_PIECE", 7)
    monkeypatch.setattr("armd.compensation.diagnose.problem.pairs.PAIRS_CHUNK", 2)
    found = signatures.grams(jacobian, some)
    gram = columns @ columns.T
    np.testing.assert_allclose(found[2], [gram[:2, :2]])
    np.testing.assert_allclose(found[1], gram[[2, 3], [2, 3]][:, None, None])


def test_instants_lie_between_readings_spread_over_these_not_over_the_hours() -> None:
    time_s = np.concatenate([np.arange(900.0), [1e6, 1e6, 2e6]])
    between = moments(np.random.default_rng(3).permutation(time_s))
    assert len(between) == 901 and not np.isin(between, time_s).any()
    assert grid(between[:5]) == tuple(between[:5])
    picked = np.array(grid(between))
    assert len(picked) == MOST_INSTANTS and (picked < 900).all()
    assert np.diff(picked).max() < 2 * np.diff(picked).min()


def test_one_other_temperature_than_the_usual_is_a_change() -> None:
    assert span(np.full((4, 2), 23.0), None).tolist() == [0.0, 0.0]
    assert span(np.full((4, 2), 23.0), 20.0).tolist() == [3.0, 3.0]

"""Uncertainties of many rows, put together once for equal neighbours, against row by row."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_model import POSE_FACTORS, SLOW_FACTORS, some_states

from armd.compensation.kernel.model import Model
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.model.kinematics import compute_jacobian
from armd.compensation.model.parameters import ParameterLayout
from armd.compensation.model.state import States
from support.drawn_calibration import REFERENCE_C, WARM, an_arm, calibrated, term
from support.selection import parametrize_default

N_JOINTS = 3
NAMES = ParameterLayout(N_JOINTS).names
ARM = an_arm(N_JOINTS)
NOISE = {"encoder_rad": [1e-6, 2e-6, 3e-6], "temperature_c": 0.05, "reading_mm": 0.02}
TERMS = [
    term("a_1", {**WARM, "order": 2}),
    term("theta_2", POSE_FACTORS[0], WARM),
    term("d_3", POSE_FACTORS[4], coefficient=2e-3),
    term("a_1", {**WARM, "lag_s": 30.0}),
    term("alpha_2", WARM, {"kind": "time", "since_unix_s": 1.7e9}),
]


def uncertain(seed: int, terms: list[dict[str, object]], noise: object) -> LoadedCalibration:
    rng = np.random.default_rng(seed)
    of = [*rng.choice(NAMES, 6, replace=False), *(f"term {t}" for t in range(len(terms)))]
    root = 1e-4 * rng.normal(size=(len(of), len(of)))
    covariance = (root @ root.T).tolist()
    return calibrated(ARM, terms, covariance_of=of, covariance=covariance, noise=noise)


def row_by_row(arm: Arm, calibration: LoadedCalibration, states: States) -> np.ndarray:
    """u² = diag(J Σ J') + encoders + sensors + readings, each row by itself in plain arrays.

    What a sensor's error does is told as if every lag had settled.
    """
    content = calibration.content
    constants, layout, noise = content.vector(arm.n_joints), arm.layout, content.noise

    def settled(more_c: np.ndarray) -> np.ndarray:
        warmed = replace(states, temperature_c=states.temperature_c + more_c)
        return compute_basis_values(
            content.terms, warmed, arm, REFERENCE_C, constants, lambda _, value, *__: value
        )

    values = compute_basis_values(content.terms, states, arm, REFERENCE_C, constants)
    derivatives = compute_jacobian(
        states.q, compute_parameter_rows(constants, content.terms, values)
    )[1]
    warmed = [
        settled(noise.temperature_c * sensor) - settled(0 * sensor)
        for sensor in np.eye(len(arm.sensors))
    ]
    of_term = [layout.index(t.parameter) for t in content.terms]
    coefficients = np.array([t.coefficient for t in content.terms])
    variance = np.full((states.n, 3), noise.reading_mm**2)
    for i in range(states.n):
        by_term = derivatives[i][:, of_term]
        by_name = {name: derivatives[i][:, p] for p, name in enumerate(layout.names)}
        by_name |= {f"term {t}": by_term[:, t] * values[i, t] for t in range(len(of_term))}
        for a, name in enumerate(content.covariance_of):
            for b, other in enumerate(content.covariance_of):
                variance[i] += content.covariance[a][b] * by_name[name] * by_name[other]
        angles = derivatives[i][:, layout.angles][:, : len(noise.encoder_rad)]
        variance[i] += (angles**2) @ np.square(noise.encoder_rad)
        for change in warmed:
            variance[i] += (by_term @ (coefficients * change[i])) ** 2
    return np.sqrt(variance)


def compared(calibration: LoadedCalibration, states: States) -> np.ndarray:
    model = Model(ARM, calibration)
    found = model.uncertainty_rows(states, model.slow_values(states))
    expected = row_by_row(ARM, calibration, states)
    assert found == pytest.approx(expected, rel=1e-9, abs=0, nan_ok=True)
    return found


def celsius(kind: str, n: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    if kind == "each row another":
        return rng.uniform(15, 30, (n, 2))
    if kind == "constant":
        return np.tile([26.0, 23.0], (n, 1))
    runs = np.repeat(rng.uniform(15, 30, (-(-n // 90), 2)), 90, axis=0)[:n]  # wider than a block
    if kind == "missing":
        runs[100:140, 0] = np.nan
        runs[::7, 1] = np.nan
    return runs


@parametrize_default("kind", ["each row another", "constant", "in runs", "missing"], default=2)
@pytest.mark.parametrize(
    "terms", [TERMS, TERMS[:1], TERMS[2:3], []], ids=["all", "warm", "pose", "none"]
)
def test_as_row_by_row(terms: list[dict[str, object]], kind: str) -> None:
    states = replace(some_states(400, N_JOINTS), temperature_c=celsius(kind, 400))
    found = compared(uncertain(1, terms, NOISE), states)
    warm = any(factor["kind"] == "temperature" for t in terms for factor in t["basis"])  # type: ignore[attr-defined]
    assert np.isnan(found).any() == (warm and kind == "missing")


@settings(max_examples=25, deadline=None)
@given(data=st.data(), seed=st.integers(0, 10**6), noise_c=st.sampled_from([0.0, 0.02]))
def test_any_terms(data: st.DataObject, seed: int, noise_c: float) -> None:
    factors = st.lists(st.sampled_from(POSE_FACTORS + SLOW_FACTORS), min_size=1, max_size=3)
    drawn = data.draw(st.lists(st.tuples(st.sampled_from(NAMES), factors), max_size=6))
    terms = [term(name, *basis) for name, basis in drawn]
    noise = {**NOISE, "temperature_c": noise_c}
    compared(uncertain(seed, terms, noise), some_states(70, N_JOINTS, seed))


def test_a_date_may_count_where_the_value_does_not_move() -> None:
    """At the reference temperature a warm term that grows with time is nothing, and what a sensor's
    error makes of it grows."""
    growing = term("a_1", WARM, {"kind": "time", "since_unix_s": 1.7e9}, coefficient=0.1)
    states = replace(some_states(200, N_JOINTS), temperature_c=np.full((200, 2), REFERENCE_C))
    states = replace(states, time_s=1.7e9 + 60.0 * np.arange(200))
    content = calibrated(ARM, [growing], noise={"encoder_rad": [0.0] * 3, "temperature_c": 0.5})
    found = np.linalg.norm(compared(content, states), axis=1)
    assert found[0] == 0 and found[100] > 0 and found[199] == pytest.approx(found[100] * 1.99)


def test_nothing_known_is_nothing_told() -> None:
    model, states = Model(ARM, calibrated(ARM, TERMS)), some_states(5, N_JOINTS)
    assert np.isnan(model.uncertainty_rows(states, model.slow_values(states))).all()

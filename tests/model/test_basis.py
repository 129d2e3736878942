"""Basis functions against their definitions, gravity against finite differences of energy."""

from __future__ import annotations

import gc
import math
import weakref

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.curve import compute_curve_pieces, evaluate_curve
from armd.compensation.model.gravity import (
    compute_gravity_directions,
    compute_gravity_moments,
    compute_gravity_torques,
    list_link_masses,
)
from armd.compensation.model.kinematics import compute_frames, compute_pose
from armd.compensation.model.parameters import ParameterLayout
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term

REFERENCE_C = 20.0


def an_arm(**of_first_joint: object) -> Arm:
    joint = {"d_mm": 300.0, "a_mm": 40.0, "alpha_deg": 80.0, "beta_deg": 5.0, "temperature": "t1"}
    joints = [{**joint, **of_first_joint}, joint, {**joint, "mass_kg": 0.7}, joint]
    return Arm.model_validate(
        {
            "schema": "armd.arm/1",
            "serial_number": "TEST",
            "gravity": [0.6, 0.0, -0.8],
            "temperature_sensor": [{"name": "t1"}, {"name": "t2"}],
            "joint": joints,
            "tip": {"offset_mm": [10.0, 20.0, 150.0]},
        }
    )


def some_states(n: int = 50) -> States:
    rng = np.random.default_rng(2)
    approach = rng.normal(size=(n, 3))
    return States(
        q=rng.uniform(-3, 3, (n, 4)),
        rate=rng.normal(size=(n, 4)),
        temperature_c=rng.uniform(15, 35, (n, 2)),
        time_s=1.7e9 + np.arange(n) * 60.0,
        approach=approach / np.linalg.norm(approach, axis=1, keepdims=True),
        series=np.zeros(n, np.int64),
    )


def value_of(basis: list[dict[str, object]], states: States, arm: Arm | None = None) -> np.ndarray:
    arm = arm or an_arm()
    term = Term.model_validate({"parameter": "theta_1", "basis": basis})
    return compute_basis_values([term], states, arm, REFERENCE_C, arm.nominal())[:, 0]


S = some_states()
Q, W, T, A = S.q, S.rate, S.temperature_c, S.approach
MEAN = {"t1": 0.25, "t2": 0.75}
MEAN_C = T @ [0.25, 0.75]
CURVE = [0.0, 1.0, -2.0, 0.5, 3.0]
DEFINITIONS = [
    ({"kind": "temperature", "weights": MEAN, "order": 3}, (MEAN_C - 20) ** 3),
    ({"kind": "temperature", "weights": {"t2": 1}, "reference_c": 22}, T[:, 1] - 22),
    (
        {"kind": "temperature", "weights": MEAN, "zone_c": [22, 28], "order": 2},
        (np.clip(MEAN_C, 22, 28) - 22) ** 2,
    ),
    ({"kind": "time", "since_unix_s": 1.7e9, "power": 2}, (np.arange(50) / 60) ** 2),
    (
        {"kind": "relaxation", "since_unix_s": 1.7e9 + 300, "time_constant_s": 900},
        1 - np.exp(-np.maximum(np.arange(50) - 5, 0) / 15),
    ),
    (
        {
            "kind": "relaxation",
            "since_unix_s": 1.7e9,
            "until_unix_s": 1.7e9 + 600,
            "time_constant_s": 900,
        },
        1 - np.exp(-np.minimum(np.arange(50), 10) / 15),
    ),
    (
        {"kind": "daily_sin", "since_unix_s": 1.7e9 - 21600, "until_unix_s": 1.7e9 + 600},
        np.cos(2 * np.pi * np.minimum(np.arange(50), 10) / 1440),
    ),
    (
        {"kind": "daily_cos", "since_unix_s": 1.7e9 + 1200},
        np.cos(2 * np.pi * np.maximum(np.arange(50) - 20, 0) / 1440),
    ),
    ({"kind": "after", "instant_unix_s": 1.7e9 + 600}, 1.0 * (np.arange(50) >= 10)),
    ({"kind": "sin", "joint": 2, "order": 3}, np.sin(3 * Q[:, 1])),
    ({"kind": "cos", "joint": 4}, np.cos(Q[:, 3])),
    ({"kind": "angle", "joint": 3, "power": 2}, Q[:, 2] ** 2),
    ({"kind": "side", "joint": 1}, np.sign(W[:, 0])),
    ({"kind": "rate", "joint": 2}, W[:, 1]),
    ({"kind": "approach", "axis": "y"}, A[:, 1]),
    (
        {"kind": "approach", "axis": "z", "frame": "tip"},
        np.einsum("ni,ni->n", compute_pose(Q, an_arm().nominal())[1][:, :, 2], A),
    ),
    (
        {"kind": "curve", "joint": 2, "values": CURVE},
        CubicSpline(np.linspace(0.0, math.tau, 6), [*CURVE, CURVE[0]], bc_type="periodic")(Q[:, 1]),
    ),
]


@pytest.mark.parametrize(("factor", "expected"), DEFINITIONS, ids=lambda x: str(x)[:40])
def test_a_factor_is_what_its_definition_says(factor, expected) -> None:
    assert value_of([factor], S) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_a_term_is_the_product_of_its_factors() -> None:
    factors = [factor for factor, _ in DEFINITIONS]
    expected = np.prod([values for _, values in DEFINITIONS], axis=0)
    assert value_of(factors, S) == pytest.approx(expected, rel=1e-10)
    assert value_of([], S) == pytest.approx(np.ones(50))


def test_missing_values() -> None:
    temperature = T.copy()
    temperature[3, 1] = np.nan
    rate, approach = np.full_like(W, np.nan), np.full_like(A, np.nan)
    states = States(Q, rate, temperature, S.time_s, approach, S.series)
    mean = value_of([{"kind": "temperature", "weights": MEAN}], states)
    assert np.flatnonzero(np.isnan(mean)).tolist() == [3]
    first = value_of([{"kind": "temperature", "weights": {"t1": 1.0, "t2": 0.0}}], states)
    assert first == pytest.approx(T[:, 0] - 20), "a sensor without weight does not matter"
    for kind in ({"kind": "side", "joint": 1}, {"kind": "rate", "joint": 1}):
        assert not value_of([kind], states).any()
    for frame in ("base", "tip"):
        assert not value_of([{"kind": "approach", "axis": "x", "frame": frame}], states).any()


def test_states_go_with_their_last_use_not_at_the_next_collection_of_garbage() -> None:
    """A long table goes by in pieces: what kept them that long was most of its memory."""
    states = some_states()
    gone = weakref.ref(states)
    gc.disable()
    try:
        value_of([{"kind": "rate", "joint": 2}], states)
        del states
        assert gone() is None
    finally:
        gc.enable()


def test_temperature_rate_is_the_slope_of_the_smoothed_temperature() -> None:
    time_s = S.time_s
    ramp = np.column_stack([20 + 0.002 * (time_s - time_s[0]), T[:, 1]])
    states = States(Q, W, ramp, time_s, A, S.series)
    factor = {"kind": "temperature_rate", "weights": {"t1": 1.0}, "smoothing_s": 120.0}
    expected = 0.002 * (1 - np.exp(-(time_s - time_s[0]) / 120.0))
    assert value_of([factor], states) == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_parameter_rows_add_up() -> None:
    arm = an_arm()
    terms = [
        Term.model_validate({"parameter": name, "basis": [], "coefficient": coefficient})
        for name, coefficient in (("a_2", 0.5), ("tip_z", -1.0), ("a_2", 0.25))
    ]
    values = np.array([[1.0, 2.0, 4.0], [0.0, 0.0, 0.0]])
    rows = compute_parameter_rows(arm.nominal(), terms, values)
    changed = rows[0] - arm.nominal()
    assert changed[ParameterLayout(4).index("a_2")] == 1.5
    assert changed[ParameterLayout(4).index("tip_z")] == -2.0
    assert np.count_nonzero(changed) == 2
    assert np.array_equal(rows[1], arm.nominal())


def energy(q: np.ndarray, arm: Arm) -> np.ndarray:
    """Potential energy in J of the arm's links."""
    kg, centre_mm = list_link_masses(arm)
    origins, rotations = compute_frames(q, arm.nominal())
    height_mm = np.zeros(len(q))
    for k in range(arm.n_joints):
        centre = origins[:, k + 1] + rotations[:, k + 1] @ centre_mm[k]
        height_mm -= kg[k] * centre @ np.array(arm.gravity)
    return 9.80665e-3 * height_mm


def test_gravity_torque_is_the_slope_of_the_energy() -> None:
    arm = an_arm(mass_kg=2.0, centre_of_mass_mm=(10.0, -100.0, 5.0))
    torques = compute_gravity_torques(Q, arm.nominal(), arm)
    for k in range(4):
        step = np.zeros(4)
        step[k] = 1e-5
        slope = (energy(Q + step, arm) - energy(Q - step, arm)) / 2e-5
        assert torques[:, k] == pytest.approx(-slope, rel=1e-6, abs=1e-6)
    assert value_of([{"kind": "gravity_torque", "joint": 2}], S, arm) == pytest.approx(
        torques[:, 1]
    )


def test_gravity_moment_and_direction_in_the_link_frame() -> None:
    arm = an_arm()
    p, down = arm.nominal(), np.array(arm.gravity)
    moments, directions = compute_gravity_moments(Q, p, arm), compute_gravity_directions(Q, p, arm)
    kg, centre_mm = list_link_masses(arm)
    origins, rotations = compute_frames(Q, p)
    for i in range(5):
        for link in range(1, 5):
            moment = np.zeros(3)
            for j in range(link + 1, 5):
                centre = origins[i, j] + rotations[i, j] @ centre_mm[j - 1]
                force = kg[j - 1] * 9.80665 * down
                moment += np.cross((centre - origins[i, link]) / 1000, force)
            expected = rotations[i, link].T @ moment
            assert moments[i, link - 1] == pytest.approx(expected, abs=1e-10)
            assert directions[i, link - 1] == pytest.approx(rotations[i, link].T @ down, abs=1e-12)
    assert not moments[:, 3].any(), "the last link carries nothing"


def test_default_masses_lie_in_the_middle_of_their_links() -> None:
    arm = an_arm()
    kg, centre_mm = list_link_masses(arm)
    assert kg[:2] == pytest.approx(math.hypot(300, 40) / 1000)
    assert kg[2] == 0.7
    origins, rotations = compute_frames(Q[:1], arm.nominal())
    middle = origins[0, 1] + rotations[0, 1] @ centre_mm[0]
    assert middle == pytest.approx((origins[0, 0] + origins[0, 1]) / 2, abs=1e-9)
    tip = compute_pose(Q[:1], arm.nominal())[0][0]
    assert kg[3] == pytest.approx(np.linalg.norm(tip - origins[0, 3]) / 1000)


@pytest.mark.parametrize("n", [4, 5, 64, 511, 512])
def test_a_curve_is_scipys_periodic_spline(n: int) -> None:
    values = np.random.default_rng(n).normal(size=n)
    turn = np.linspace(0.0, math.tau, n + 1)
    spline = CubicSpline(turn, [*values, values[0]], bc_type="periodic")
    scale = np.abs(spline.c[::-1].T).max(axis=0)
    np.testing.assert_allclose(
        compute_curve_pieces(values) / scale, spline.c[::-1].T / scale, atol=1e-12
    )
    angle = np.concatenate([turn, np.random.default_rng(1).uniform(-9, 9, 300), [np.nan]])
    np.testing.assert_allclose(evaluate_curve(values, angle), spline(angle), atol=1e-12)

"""The kernel against plain arrays: every kind of term, every cut into batches, covariances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from armd import POINT
from armd.compensation.kernel import kernel
from armd.compensation.kernel.model import Model
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.parameters import ParameterLayout
from armd.compensation.model.state import States
from support.drawn_calibration import REFERENCE_C, WARM, an_arm, calibrated, term
from support.readings import states_of

CURVE = [0.0, 1.0, 0.5, -2.0, 0.25, 3.0, -1.0]
POSE_FACTORS = [
    {"kind": "sin", "joint": 2},
    {"kind": "cos", "joint": 3, "order": 7},
    {"kind": "angle", "joint": 1, "power": 3},
    {"kind": "curve", "joint": 3, "values": CURVE},
    {"kind": "gravity_torque", "joint": 2},
    {"kind": "gravity_direction", "link": 3, "axis": "y"},
    {"kind": "gravity_moment", "link": 1, "axis": "z"},
    {"kind": "side", "joint": 1},
    {"kind": "rate", "joint": 3},
    {"kind": "approach", "axis": "x"},
    {"kind": "approach", "axis": "z", "frame": "tip"},
]
SLOW_FACTORS = [
    WARM,
    {**WARM, "order": 3, "lag_s": 40.0},
    {**WARM, "zone_c": [22.0, 25.0]},
    {"kind": "temperature_rate", "weights": {"t2": 1.0}, "smoothing_s": 30.0},
    {"kind": "time", "since_unix_s": 1.7e9},
    {"kind": "relaxation", "since_unix_s": 1.7e9, "time_constant_s": 60.0},
    {"kind": "daily_cos", "since_unix_s": 1.6e9, "until_unix_s": 1.7e9},
    {"kind": "after", "instant_unix_s": 1.7e9 + 100},
]


def some_states(n: int, n_joints: int, seed: int = 1) -> States:
    rng = np.random.default_rng(seed)
    approach = rng.normal(size=(n, 3))
    rate = rng.normal(size=(n, n_joints)) * rng.integers(0, 2, (n, n_joints))
    rate[rng.random((n, n_joints)) < 0.1] = np.nan
    approach[rng.random(n) < 0.1] = np.nan
    return states_of(
        rng.uniform(-7, 7, (n, n_joints)),
        rate=rate,
        temperature_c=np.repeat(rng.uniform(18, 28, (-(-n // 3), 2)), 3, axis=0)[:n],
        time_s=1.7e9 + np.arange(n) * 2.0,
        approach=approach / np.linalg.norm(approach, axis=1, keepdims=True),
    )


def reference(arm: Arm, calibration: LoadedCalibration, states: States) -> np.ndarray:
    """Positions by way of the parameters of each row."""
    content = calibration.content
    constants = content.vector(arm.n_joints)
    values = compute_basis_values(content.terms, states, arm, REFERENCE_C, constants)
    return compute_pose(states.q, compute_parameter_rows(constants, content.terms, values))[0]


def check(arm: Arm, terms: list[dict[str, object]], n: int = 150) -> None:
    calibration = calibrated(arm, terms)
    states = some_states(n, arm.n_joints)
    position, correction = Model(arm, calibration).correct_states(states)
    assert position == pytest.approx(reference(arm, calibration, states), abs=2e-9)
    plain, _ = compute_pose(states.q, calibration.content.vector(arm.n_joints))
    assert correction == pytest.approx(position - plain, abs=2e-9)
    if terms:
        assert np.abs(correction).max() > 1e-5, "the terms do something"


@pytest.mark.parametrize("factor", POSE_FACTORS + SLOW_FACTORS, ids=lambda f: str(f)[9:50])
def test_each_factor_on_its_own(factor: dict[str, object]) -> None:
    check(an_arm(4), [term("theta_2", factor)])


def test_no_terms_is_plain_forward_kinematics() -> None:
    check(an_arm(5), [])


@settings(max_examples=25, deadline=None)
@given(data=st.data(), n_joints=st.integers(3, 9))
def test_any_terms_together(data: st.DataObject, n_joints: int) -> None:
    factors = st.sampled_from(POSE_FACTORS + SLOW_FACTORS)
    drawn = st.tuples(
        st.sampled_from(ParameterLayout(n_joints).names), st.lists(factors, min_size=1, max_size=3)
    )
    terms = data.draw(st.lists(drawn, min_size=1, max_size=12))
    arm = an_arm(n_joints)
    calibration = calibrated(arm, [term(name, *basis) for name, basis in terms])
    states = some_states(70, n_joints)
    position, _ = Model(arm, calibration).correct_states(states)
    expected = reference(arm, calibration, states)
    assert position == pytest.approx(expected, abs=1e-9 * max(1.0, np.abs(expected).max()))


def points_of(model: Model, states: States, cuts: list[int]) -> np.ndarray:
    """All rows at the model's own fold, cut into batches."""
    points = np.zeros(states.n, POINT)
    for first, end in zip([0, *cuts], [*cuts, states.n], strict=True):
        rows = slice(first, end)
        if first < end:
            model.correct(states.q[rows], states.rate[rows], states.approach[rows], points[rows])
    return points


@settings(max_examples=30, deadline=None)
@given(cuts=st.lists(st.integers(0, 200), max_size=12).map(sorted))
def test_points_do_not_depend_on_how_samples_were_cut(cuts: list[int]) -> None:
    assert points_of(LIVE, STATES, cuts).tobytes() == WHOLE.tobytes()


NOISE = {"encoder_rad": [1e-6] * 4, "temperature_c": 0.01}
LIVE_ARM = an_arm(4)
LIVE_TERMS = [term("theta_2", factor) for factor in POSE_FACTORS] + [term("a_1", WARM)]
COVARIANCE = {
    "covariance_of": ["theta_1", "a_2", "term 0", "term 11"],
    "covariance": np.diag([1e-10, 1e-4, 1e-10, 1e-8]).tolist(),
}
LIVE = Model(LIVE_ARM, calibrated(LIVE_ARM, LIVE_TERMS, noise=NOISE, **COVARIANCE))
LIVE.fold(np.array([25.0, 24.0]), 1.7e9)
STATES = some_states(200, 4)
WHOLE = points_of(LIVE, STATES, [])


def test_live_equals_offline() -> None:
    arm = an_arm(4)
    terms = [term("theta_2", factor) for factor in POSE_FACTORS]
    terms += [term("a_1", factor) for factor in SLOW_FACTORS]
    terms += [term("alpha_3", POSE_FACTORS[0], SLOW_FACTORS[1])]
    model = Model(arm, calibrated(arm, terms))
    states = some_states(60, 4)
    offline, correction = model.correct_states(states)
    points = np.zeros(60, POINT)
    for i in range(60):
        model.fold(states.temperature_c[i], float(states.time_s[i]))
        row = slice(i, i + 1)
        model.correct(states.q[row], states.rate[row], states.approach[row], points[row])
    # Two compiled functions: where LLVM fuses a·b+c in one and not in the other, last bits differ.
    assert points["position_mm"] == pytest.approx(offline, rel=0, abs=1e-10)
    assert points["correction_mm"] == pytest.approx(correction, rel=1e-6, abs=1e-12)


def test_orientation_is_the_last_frames() -> None:
    arm = an_arm(6)
    model = Model(arm, None)
    states = some_states(300, 6)
    points = np.zeros(300, POINT)
    model.correct(states.q, states.rate, states.approach, points)
    rotation = Rotation.from_matrix(compute_pose(states.q, arm.nominal())[1])
    turn = rotation.inv() * Rotation.from_quat(points["orientation"])
    assert np.abs(turn.as_rotvec()).max() < 1e-14
    assert (points["orientation"][:, 3] >= 0).all()


def test_half_turns_have_an_orientation() -> None:
    joint = {"d_mm": 100.0}
    arm = an_arm(3).model_copy(update={"joint": [an_arm(3).joint[0].model_validate(joint)] * 3})
    points = np.zeros(1, POINT)
    Model(arm, None).correct(
        np.array([[np.pi, 0.0, 0.0]]), np.zeros((1, 3)), np.zeros((1, 3)), points
    )
    assert np.abs(points["orientation"][0]) == pytest.approx([0, 0, 1, 0], abs=1e-12)


def test_without_a_calibration_uncertainty_is_unknown() -> None:
    points = points_of(Model(LIVE_ARM, None), STATES, [])
    assert np.isnan(points["covariance_mm2"]).all()
    assert points["position_mm"] == pytest.approx(
        compute_pose(STATES.q, LIVE_ARM.nominal())[0], abs=1e-9
    )
    assert not points["correction_mm"].any()


def test_uncorrected_is_by_the_constants_alone() -> None:
    constants = calibrated(LIVE_ARM, []).content.vector(4)
    position = np.empty((STATES.n, 3))
    kernel.compute_uncorrected(np.ascontiguousarray(STATES.q), LIVE.flat, position)
    assert position == pytest.approx(compute_pose(STATES.q, constants)[0], abs=1e-9)


@pytest.mark.parametrize("parameter", ["d_1", "theta_1", "base_y", "base_z", "base_rz", "tip_x"])
def test_a_position_is_known_as_a_whole(parameter: str) -> None:
    """What a missing temperature moves may be one coordinate alone, as the height of the base."""
    arm, states = an_arm(4), some_states(9, 4)
    celsius = states.temperature_c.copy()
    celsius[5, 1] = np.nan
    states = replace(states, temperature_c=celsius)
    calibration = calibrated(arm, [term(parameter, WARM)])
    model = Model(arm, calibration)
    slow = model.slow_values(states)
    for position in (
        model.position_rows(states, slow),
        *model.correct_rows(states, slow),
        reference(arm, calibration, states),
    ):
        assert np.isnan(position).all(axis=1).tolist() == [row == 5 for row in range(9)]
        assert np.isfinite(np.delete(position, 5, axis=0)).all()

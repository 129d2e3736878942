"""How residuals move with constants, coefficients, poses and seats: against small steps of each."""

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.estimate.linearise import Linearisation, linearise, linearise_as_read
from armd.compensation.estimate.observations import collect_observations
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.estimate.placements.poses import Poses
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.pose_factors import Harmonic
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from support import synthetic
from support.slopes import compute_pose_slopes, compute_target_slopes

ARM = synthetic.arm()
TERMS = [
    Term(parameter="a_2", basis=[Temperature(weights={"t2": 1.0})], coefficient=0.001),
    Term(parameter="theta_3", basis=[Harmonic(kind="sin", joint=3, order=1)], coefficient=1e-5),
]
STEP = 1e-5


def problem() -> tuple[Linearisation, np.ndarray]:
    """Where the tip stands where it was held: columns are then at the angles as read."""
    rng = np.random.default_rng(3)
    truth = synthetic.disturbed(ARM, rng)
    session = synthetic.session(ARM, truth, rng, terms=TERMS, readings=60, known=False, targets=3)
    observations = collect_observations([session], ARM)
    at = linearise(observations, truth, TERMS, poses_of(observations, truth), 20.0)
    assert np.abs(at.residual_mm).max() < 1e-5
    return at, truth


def poses_of(observations, constants) -> Poses:
    at = linearise(
        observations, constants, TERMS, fit_poses(observations, plain(observations)), 20.0
    )
    return fit_poses(observations, at.position_mm)


def plain(observations) -> np.ndarray:
    position: np.ndarray = compute_pose(
        observations.states.q, np.tile(ARM.nominal(), (observations.n, 1))
    )[0]
    return position


def residual(at: Linearisation, constants, terms, poses: Poses) -> np.ndarray:
    found: np.ndarray = linearise(at.observations, constants, terms, poses, 20.0).residual_mm
    return found


def test_constants_and_coefficients() -> None:
    at, truth = problem()
    names = [name for name in ARM.layout.names if not name.startswith("base")]
    columns = at.make_constant_columns(names)
    for i, name in enumerate(names):
        there = [truth.copy(), truth.copy()]
        for sign, constants in zip((1, -1), there, strict=True):
            constants[ARM.layout.index(name)] += sign * STEP
        ahead, behind = (residual(at, constants, TERMS, at.poses) for constants in there)
        np.testing.assert_allclose(columns[:, :, i], (ahead - behind) / (2 * STEP), atol=2e-3)
    by_term = at.make_term_columns(TERMS, at.basis)
    asked = Unknowns(["a_1", "theta_1"], [0, 1]).columns(at.jacobian, at.basis, TERMS)
    np.testing.assert_array_equal(asked[:, :, 2:], by_term)
    assert not asked[:, :, 1].any() and asked[:, :, 0].any()  # θ₁ moves every placement alike
    for i, term in enumerate(TERMS):
        both = []
        for sign in (1, -1):
            moved = term.model_copy(update={"coefficient": term.coefficient + sign * STEP})
            both.append(residual(at, truth, [*TERMS[:i], moved, *TERMS[i + 1 :]], at.poses))
        np.testing.assert_allclose(by_term[:, :, i], (both[0] - both[1]) / (2 * STEP), atol=2e-3)


def test_poses_and_seats_and_some_rows_only() -> None:
    at, truth = problem()

    def moved(poses: Poses) -> np.ndarray:
        return residual(at, truth, TERMS, poses)

    np.testing.assert_allclose(at.pose_columns, compute_pose_slopes(at, moved, STEP), atol=1e-5)
    np.testing.assert_allclose(at.target_columns, compute_target_slopes(at, moved, STEP), atol=1e-5)
    assert at.free_targets.tolist() == [0, 1, 2]
    some = at.rows(at.observations.target != 1)
    assert some.free_targets.tolist() == [0, 2]
    np.testing.assert_array_equal(some.jacobian, at.jacobian[at.observations.target != 1])


def test_where_nothing_is_left_angles_read_and_adjusted_are_one() -> None:
    at, truth = problem()
    read = linearise_as_read(at.observations, truth, TERMS, at.basis)
    for name in ("residual_mm", "jacobian", "pose_columns", "target_columns"):
        assert getattr(read, name) == pytest.approx(getattr(at, name), abs=1e-3), name


def test_columns_as_read_are_those_of_the_angles_read() -> None:
    at, truth = problem()
    observations, n = at.observations, at.observations.n
    turned = at.poses.moved(
        at.centre_mm, np.full((len(at.centre_mm), 6), 0.5), 0.0 * at.poses.target_mm
    )
    off = linearise(observations, truth, TERMS, turned, 20.0)
    read = linearise_as_read(observations, truth, TERMS, at.basis)
    index = ARM.layout.index("a_2")
    rows = np.tile(truth, (n, 1)) + 0.0
    further = rows.copy()
    further[:, index] += STEP
    values = np.array([term.coefficient for term in TERMS]) * at.basis
    for term, value in zip(TERMS, values.T, strict=True):
        rows[:, ARM.layout.index(term.parameter)] += value
        further[:, ARM.layout.index(term.parameter)] += value
    slope = (
        compute_pose(observations.states.q, further)[0]
        - compute_pose(observations.states.q, rows)[0]
    ) / STEP
    assert read.jacobian[:, :, index] == pytest.approx(slope, abs=1e-4)
    assert np.abs(off.jacobian[:, :, index] - slope).max() > 1e-3


def test_a_reading_half_a_turn_off_moves_no_other() -> None:
    """By least squares it would move its placement by hundreds of noises."""
    at, truth = problem()
    q = at.observations.states.q.copy()
    q[7, 1] += 0.5
    states = replace(at.observations.states, q=q)
    wrong = replace(at.observations, states=states)
    values = at.basis
    clean = linearise_as_read(at.observations, truth, TERMS, values).residual_mm
    found = linearise_as_read(wrong, truth, TERMS, values).residual_mm
    others = np.arange(len(q)) != 7
    assert np.linalg.norm(found[7]) > 50.0
    np.testing.assert_allclose(found[others], clean[others], atol=1e-3)

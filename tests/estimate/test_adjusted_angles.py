"""Angles turned so that the tip stands where it was held: by the smallest turn, without a bias."""

import numpy as np
import pytest

from armd.compensation.estimate.adjustment import (
    MOST_TURN_RAD,
    adjust_angles,
    compute_backwards_map,
)
from armd.compensation.model.kinematics import compute_joint_jacobian, compute_pose
from support import synthetic

ARM = synthetic.arm()
NOMINAL = ARM.nominal()


def postures(n: int, seed: int = 1) -> np.ndarray:
    """All over the turn, but for those whose tip can hardly be moved in some direction."""
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (20 * n, 6))
    singular = np.linalg.svd(compute_joint_jacobian(q, NOMINAL), compute_uv=False)
    return q[singular[:, 2] > 0.2 * singular[:, 0]][:n]


def test_backwards_is_the_pseudo_inverse_where_the_tip_moves_all_ways() -> None:
    levers = compute_joint_jacobian(postures(50), NOMINAL)
    np.testing.assert_allclose(
        compute_backwards_map(levers), np.linalg.pinv(levers), rtol=0.2, atol=2e-4
    )
    # The damping is LEAST_LEVER squared of the longest: the turn it asks for falls short by that.
    there = levers @ compute_backwards_map(levers)
    assert np.abs(there - np.eye(3)).max() < 0.05


def test_adjusted_angles_put_the_tip_where_it_was_held_by_the_smallest_turn() -> None:
    q = postures(200)
    rng = np.random.default_rng(2)
    parameters = np.tile(NOMINAL, (len(q), 1))
    held = compute_pose(q, parameters)[0] + 0.05 * rng.normal(size=(len(q), 3))
    found = adjust_angles(q, parameters, held)
    off = held - compute_pose(q, parameters)[0]
    left = held - compute_pose(found, parameters)[0]
    assert np.linalg.norm(left) < 0.02 * np.linalg.norm(off)
    smallest = np.einsum("nij,nj->ni", np.linalg.pinv(compute_joint_jacobian(q, NOMINAL)), off)
    turn = found - q
    assert np.linalg.norm(turn - smallest) < 0.03 * np.linalg.norm(smallest)


def test_a_reading_gone_wrong_turns_no_farther_than_noise_would() -> None:
    q = postures(20)
    parameters = np.tile(NOMINAL, (len(q), 1))
    held = compute_pose(q, parameters)[0] + np.array([400.0, 0.0, 0.0])
    turn = np.linalg.norm(adjust_angles(q, parameters, held) - q, axis=1)
    assert turn.max() == pytest.approx(MOST_TURN_RAD, rel=1e-9)


def test_columns_as_read_share_three_a_reading_with_the_residual() -> None:
    """Σ cᵀ Σ⁻¹ r, c the column of all lengths in proportion: `adjustment` derives that its
    expectation at the true constants is 3 a reading where c is taken at the angles as read, and
    that this is gone at adjusted ones. Each reading is compared with itself."""
    truth, sigma = postures(4000, seed=3), 1e-3
    read = truth + sigma * np.random.default_rng(4).normal(size=truth.shape)
    parameters = np.tile(NOMINAL, (len(read), 1))
    held = compute_pose(truth, parameters)[0]
    residual = compute_pose(read, parameters)[0] - held
    levers = compute_joint_jacobian(truth, NOMINAL)
    weight = np.linalg.inv(sigma**2 * levers @ levers.transpose(0, 2, 1))

    # Of an arm s times as large the tip is s times as far: this column is the tip's position.
    beyond = adjust_angles(read, parameters, held)
    further = compute_pose(read, parameters)[0] - compute_pose(beyond, parameters)[0]
    shared = np.einsum("ni,nij,nj->n", further, weight, residual)
    assert shared.mean() == pytest.approx(3.0, abs=4 * shared.std() / np.sqrt(len(shared)))

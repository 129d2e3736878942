"""Kinematics against a product of 4 × 4 matrices written without it, and finite differences."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armd.compensation.model import kinematics, parameters
from armd.compensation.model.parameters import ParameterLayout
from support.plain_kinematics import tip_pose


def matrix_product(q: np.ndarray, p: np.ndarray) -> np.ndarray:
    """The contract's definition at one row."""
    return tip_pose(q[None], p[None])[0]


def an_arm(seed: int, n_joints: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    lengths = [parameters.find_unit(name) == "mm" for name in ParameterLayout(n_joints).names]
    scale = np.where(lengths, 600.0, 3.0)
    return rng.uniform(-4, 4, (n, n_joints)), rng.uniform(-1, 1, len(scale)) * scale


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10**6), n_joints=st.integers(3, 9))
def test_forward_is_the_matrix_product(seed: int, n_joints: int) -> None:
    q, p = an_arm(seed, n_joints, 5)
    position, last = kinematics.compute_pose(q, p)
    for i in range(len(q)):
        pose = matrix_product(q[i], p)
        assert position[i] == pytest.approx(pose[:3, 3], abs=1e-9)
        assert last[i] == pytest.approx(pose[:3, :3], abs=1e-12)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), n_joints=st.integers(3, 9))
def test_jacobian_is_the_slope_of_the_matrix_product(seed: int, n_joints: int) -> None:
    q, p = an_arm(seed, n_joints, 1)
    position, derivatives = kinematics.compute_jacobian(q, p)
    assert position[0] == pytest.approx(matrix_product(q[0], p)[:3, 3], abs=1e-9)
    for i, name in enumerate(ParameterLayout(n_joints).names):
        step = np.zeros(len(p))
        step[i] = 1e-5 if parameters.find_unit(name) == "rad" else 1e-3
        up, down = matrix_product(q[0], p + step), matrix_product(q[0], p - step)
        slope = (up - down)[:3, 3] / (2 * step[i])
        assert derivatives[0, :, i] == pytest.approx(slope, rel=1e-6, abs=1e-5), name


def test_joint_jacobian_is_the_slope_by_the_angles() -> None:
    q, p = an_arm(3, 6, 4)
    slopes = kinematics.compute_joint_jacobian(q, p)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-5
        up, down = kinematics.compute_pose(q + step, p)[0], kinematics.compute_pose(q - step, p)[0]
        assert slopes[:, :, k] == pytest.approx((up - down) / 2e-5, rel=1e-6, abs=1e-5)


def test_parameters_may_differ_from_row_to_row() -> None:
    q, p = an_arm(4, 6, 3)
    rows = p + np.random.default_rng(5).normal(0, 0.1, (3, len(p)))
    together, _ = kinematics.compute_pose(q, rows)
    position, derivatives = kinematics.compute_jacobian(q, rows)
    for i in range(3):
        alone = kinematics.compute_jacobian(q[i : i + 1], rows[i])
        assert together[i] == pytest.approx(alone[0][0], abs=1e-10)
        assert position[i] == pytest.approx(alone[0][0], abs=1e-10)
        assert derivatives[i] == pytest.approx(alone[1][0], abs=1e-9)


def test_parameters_of_another_arm_are_refused() -> None:
    with pytest.raises(ValueError, match="do not fit"):
        kinematics.compute_pose(np.zeros((2, 6)), np.zeros(34))

"""Derivatives by blocks, against central differences of the forward kinematics."""

import numpy as np
import pytest

from armd.compensation.kernel.block_jacobian import (
    compute_block_jacobian,
    find_row,
    make_work,
    take_parameters,
)
from armd.compensation.kernel.memory import BLOCK
from armd.compensation.model.kinematics import compute_pose
from support.selection import parametrize_default


def difference(q: np.ndarray, parameters: np.ndarray, column: int) -> np.ndarray:
    """The derivative (n, 3) of the tip by one parameter, by Richardson's extrapolation."""
    slopes = []
    for step in (1e-3, 5e-4):
        sides = []
        for sign in (1.0, -1.0):
            moved = parameters.copy()
            moved[:, column] += sign * step
            sides.append(np.concatenate([compute_pose(q[[i]], p)[0] for i, p in enumerate(moved)]))
        slopes.append((sides[0] - sides[1]) / (2 * step))
    return (4 * slopes[1] - slopes[0]) / 3


@parametrize_default("n_joints", [6, 3, 9])
def test_they_are_the_slopes_of_the_tip(n_joints: int) -> None:
    rng = np.random.default_rng(n_joints)
    m = 5  # the last block of a table is not full
    parameters = rng.uniform(-1, 1, (BLOCK, 5 * n_joints + 9))
    lengths = [i for i in range(5 * n_joints) if i % 5 in (1, 2)]
    parameters[:, [*lengths, *range(5 * n_joints, 5 * n_joints + 6)]] *= 100
    q = rng.uniform(-3, 3, (7, n_joints))
    work, columns = make_work(n_joints, 0), np.ascontiguousarray(parameters.T)
    take_parameters(columns, n_joints, work)
    compute_block_jacobian(q, 2, m, columns, work)
    for column in range(parameters.shape[1]):
        first = find_row(column, n_joints)
        expected = difference(q[2 : 2 + m], parameters[:m], column)
        found = work[first : first + 3, :m].T
        assert found == pytest.approx(expected, rel=1e-7, abs=1e-6)

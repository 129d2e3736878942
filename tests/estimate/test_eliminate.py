"""Batches of sessions, and what a session leaves of other columns, against dense algebra."""

import numpy as np
import pytest

from armd.compensation.estimate.group_rows import group_rows
from armd.compensation.estimate.linear.linear_model import factorise_known, factorise_lower
from armd.compensation.estimate.placements.eliminate import (
    SessionColumns,
    eliminate,
    split_into_batches,
)


def test_rows_are_grouped_by_session_and_placement_and_ordered_by_target() -> None:
    session, placement = np.array([1, 0, 1, 1, 0]), np.array([5, 2, 4, 5, 2])
    rows = group_rows(session, placement, np.array([3, 1, 0, 2, 0]))
    found = {s: {p: part.tolist() for p, part in parts.items()} for s, parts in rows.items()}
    assert found == {0: {2: [4, 1]}, 1: {4: [2], 5: [3, 0]}}


def test_a_batch_has_sessions_of_as_many_targets() -> None:
    sessions = [
        SessionColumns(i, {i: np.arange(3)}, np.arange(k)) for i, k in enumerate([2, 1, 2, 0])
    ]
    batches = split_into_batches(sessions, 4)
    assert [[session.number for session in batch] for batch in batches] == [[3], [1], [0, 2]]


def test_what_is_left_of_other_columns_is_what_their_projection_leaves() -> None:
    """Targets touched once and twice, one row whose target is not free."""
    rng = np.random.default_rng(3)
    columns, of_target = rng.normal(size=(9, 3, 6 + 2)), rng.normal(size=(9, 3, 3))
    slot = np.array([-1, 0, 1, 1, 2, 0, 0, 1, 2])
    session = SessionColumns(0, {0: np.arange(5), 1: np.arange(5, 9)}, np.arange(3))
    found = eliminate([session], lambda rows: (columns[rows], of_target[rows]), slot, None)[0]
    nuisance = np.zeros((9, 3, 12 + 9))
    for i, k in enumerate(slot):
        nuisance[i, :, 6 * (i >= 5) : 6 * (i >= 5) + 6] = columns[i, :, :6]
        if k >= 0:
            nuisance[i, :, 12 + 3 * k : 15 + 3 * k] = of_target[i]
    flat, rest = nuisance.reshape(27, -1), columns[:, :, 6:].reshape(27, 2)
    residual = rest - flat @ np.linalg.lstsq(flat, rest)[0]
    np.testing.assert_allclose(found.gram, residual.T @ residual, rtol=1e-8, atol=1e-10)
    assert found.rank == np.linalg.matrix_rank(flat) == 21


def test_of_a_seat_that_its_only_placement_explains_nothing_is_left() -> None:
    """Products of 1e12, of which rounding leaves more than of other columns."""
    rng = np.random.default_rng(4)
    columns = rng.normal(size=(9, 3, 6 + 1)) * [*(1e6,) * 6, 1.0]
    of_target = columns[:, :, :6] @ rng.normal(size=(6, 3))
    session = SessionColumns(0, {0: np.arange(9)}, np.arange(1))
    slot = np.zeros(9, dtype=np.int64)
    found = eliminate([session], lambda rows: (columns[rows], of_target[rows]), slot, None)[0]
    assert found.rank == 6
    pose, rest = columns[:, :, :6].reshape(27, 6), columns[:, :, 6:].reshape(27, 1)
    orthonormal = np.linalg.qr(pose)[0]
    expected = np.sum((rest - orthonormal @ (orthonormal.T @ rest)) ** 2)
    np.testing.assert_allclose(found.gram, expected)


@pytest.mark.parametrize("gauge", [False, True])
def test_the_factor_of_a_matrix_is_that_of_its_pseudo_inverse(gauge: bool) -> None:
    along = np.random.default_rng(3).normal(size=(60, 5)) * [1.0, 2.0, 0.5, 1.0, 3.0]
    if gauge:
        along[:, 4] = 2.0 * along[:, 0] - along[:, 1]
    matrix = along.T @ along / np.max(np.sum(along**2, axis=0))
    factor = factorise_known(matrix, factorise_lower(matrix[None])[0])
    assert factor.shape == (5, 5 - gauge)
    np.testing.assert_allclose(factor @ factor.T, np.linalg.pinv(matrix, rcond=1e-9), atol=1e-9)

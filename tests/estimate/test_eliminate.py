"""Batches of sessions, and what a session leaves of other columns, against dense algebra."""

import numpy as np

from armd.compensation.estimate.eliminate import SessionColumns, eliminate, split_into_batches
from armd.compensation.estimate.group_rows import group_rows


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

"""Columns kept placement by placement, against the same in full."""

import numpy as np
import pytest

from armd.compensation.estimate.linear.blocks import Blocks, to_blocks

N, DISTANCES = 14, 2
PLACEMENT = np.array([2, 0, 0, 1, 2, 2, 0, 1, 1, 3, 2, 0, 3, 3])
#: In which placements each column is not zero; none: in the distances alone.
WHERE = [(0,), (0,), (1,), (2,), (2, 3), (0, 1, 2, 3), (), (0, 1, 2, 3), (3,)]


def full(seed: int = 1) -> np.ndarray:
    columns = np.random.default_rng(seed).normal(size=(3 * N + DISTANCES, len(WHERE)))
    for j, where in enumerate(WHERE):
        columns[: 3 * N][~np.repeat(np.isin(PLACEMENT, where), 3), j] = 0.0
    columns[3 * N :, :3] = 0.0
    return columns


@pytest.fixture
def both() -> tuple[np.ndarray, Blocks]:
    columns = full()
    return columns, to_blocks([columns[:, :4], columns[:, 4:]], PLACEMENT)


def test_a_piece_holds_what_is_not_zero_in_its_placement_alone(
    both: tuple[np.ndarray, Blocks],
) -> None:
    _, blocks = both
    for piece, number in zip(blocks.pieces, np.unique(PLACEMENT), strict=True):
        np.testing.assert_array_equal(piece.rests, np.flatnonzero(number == PLACEMENT))
        np.testing.assert_array_equal(
            piece.columns, [j for j, where in enumerate(WHERE) if number in where]
        )


def test_columns_in_blocks_are_those_in_full(both: tuple[np.ndarray, Blocks]) -> None:
    columns, blocks = both
    rng = np.random.default_rng(2)
    amplitudes, others = rng.normal(size=len(WHERE)), rng.normal(size=(len(columns), 3))
    np.testing.assert_array_equal(blocks.to_dense(), columns)
    np.testing.assert_array_equal(blocks.to_dense(np.array([1, 4, 7])), columns[:, [1, 4, 7]])
    np.testing.assert_array_equal(blocks.only(slice(2, 6)).to_dense(), columns[:, 2:6])
    np.testing.assert_allclose(blocks.times(amplitudes), columns @ amplitudes, atol=1e-12)
    np.testing.assert_allclose(blocks.across(others), columns.T @ others, atol=1e-12)
    np.testing.assert_allclose(blocks.across(others[:, 0]), columns.T @ others[:, 0], atol=1e-12)


def test_whitened_they_are_multiplied_rest_by_rest(both: tuple[np.ndarray, Blocks]) -> None:
    columns, blocks = both
    whitener = np.random.default_rng(3).normal(size=(N, 3, 3))
    distance_mm = np.array([0.5, 2.0])
    expected = np.vstack(
        [
            *(
                w @ rows
                for w, rows in zip(whitener, columns[: 3 * N].reshape(N, 3, -1), strict=True)
            ),
            columns[3 * N :] / distance_mm[:, None],
        ]
    )
    found = blocks.whitened(whitener, distance_mm).to_dense()
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_other_columns_take_the_place_of_some(both: tuple[np.ndarray, Blocks]) -> None:
    columns, blocks = both
    other = full(4)[:, 3:8]
    found = blocks.replace_columns(slice(2, 5), [other[:, :1], other[:, 1:]])
    expected = np.hstack([columns[:, :2], other, columns[:, 5:]])
    np.testing.assert_array_equal(found.to_dense(), expected)
    joined = to_blocks([blocks, other], PLACEMENT)
    np.testing.assert_array_equal(joined.to_dense(), np.hstack([columns, other]))


def test_placements_that_share_no_column_stand_apart() -> None:
    columns = full()[:, [0, 1, 2, 3, 4, 8]]  # 2 and 3 share one
    apart = to_blocks([columns], PLACEMENT).independent_groups
    at_rests = columns[: 3 * N].reshape(N, 3, -1)
    assert [sorted(set(PLACEMENT[rests])) for rests, _ in apart] == [[0], [1], [2, 3]]
    for (rests, values), own in zip(apart, ([0, 1], [2], [3, 4, 5]), strict=True):
        np.testing.assert_array_equal(values, at_rests[rests][:, :, own])


#: Rests left out in turn: a placement, all but one rest of it and some of others; none.
LEFT_OUT = [
    PLACEMENT == 2,
    np.isin(np.arange(N), [1, 2, 3, 9]),
    np.isin(np.arange(N), [6, 8]),
    np.zeros(N, dtype=bool),
]


def test_clear_of_some_the_products_are_those_of_what_these_leave(
    both: tuple[np.ndarray, Blocks],
) -> None:
    """Of the whitened rows in full, each prior as one more row, without the rests left out; a piece
    without weight has none."""
    columns, blocks = both
    rng = np.random.default_rng(5)
    whitener, distance_mm = rng.normal(size=(N, 3, 3)), np.array([0.5, 2.0])
    whitener[PLACEMENT == 3] = 0.0
    residual, variance = rng.normal(size=len(columns)), np.full(len(WHERE), np.inf)
    variance[1] = 0.3
    assert blocks.in_one_piece[:3].all() and not blocks.in_one_piece[3:].any()
    alone = np.isin(np.arange(len(WHERE)), [0, 1, 2])
    each = blocks.compute_products_clear_of(
        alone, variance, whitener, distance_mm, residual, LEFT_OUT
    )
    both_of = np.hstack([columns, residual[:, None]])
    by_rest = both_of[: 3 * N].reshape(N, 3, -1)
    held = np.zeros((1, len(WHERE) + 1))
    held[0, 1] = variance[1] ** -0.5
    for out, (found, square) in zip(LEFT_OUT, each, strict=True):
        rows = np.vstack(
            [
                (whitener[~out] @ by_rest[~out]).reshape(3 * int((~out).sum()), -1),
                both_of[3 * N :] / distance_mm[:, None],
                held,
            ]
        )
        own, others = rows[:, :3], rows[:, 3:]
        left = others - own @ np.linalg.lstsq(own, others, rcond=1e-12)[0]
        np.testing.assert_allclose(found, left.T @ left, atol=1e-10)
        np.testing.assert_allclose(square, (others[:, :-1] ** 2).sum(axis=0), atol=1e-10)

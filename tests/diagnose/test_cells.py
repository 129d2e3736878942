"""Sums placement by placement and part by part, against the same rows in full."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.diagnose.scoring.cells import (
    ArtefactColumns,
    Cell,
    as_slice,
    clear_columns,
    list_rows,
    split_by_part,
)
from armd.compensation.estimate.linear.blocks import to_blocks

N, DISTANCES = 12, 2
PLACEMENT = np.array([0, 0, 1, 1, 1, 2, 2, 0, 2, 1, 0, 2])
PART = np.array([0, 0, 1, 0, 1, 1, 1, 0, 1, 1, 1, 0])
#: Placements in which each column of a change of the artefact is not zero.
WHERE = [(0,), (0,), (1,), (2,), (0, 1, 2), (0, 1, 2), ()]
#: Their numbers among all candidates' columns, and those of candidates of two columns each.
NUMBERS = np.array([4, 5, 9, 10, 11, 12, 20])
CANDIDATES = np.array([[4, 5], [6, 7], [11, 12], [9, 10]])


def full() -> np.ndarray:
    columns = np.random.default_rng(1).normal(size=(3 * N + DISTANCES, len(WHERE)))
    for j, where in enumerate(WHERE):
        columns[: 3 * N][~np.repeat(np.isin(PLACEMENT, where), 3), j] = 0.0
    columns[3 * N :, :6] = 0.0  # certified lengths know of the last one only
    return columns


def cells() -> list[Cell]:
    rng = np.random.default_rng(2)
    found = []
    for part in (0, 1):
        for placement in range(3):
            rests = np.flatnonzero((part == PART) & (placement == PLACEMENT))
            if len(rests):
                rows = list_rows(rests)
                own = np.linalg.qr(rng.normal(size=(len(rows), min(2, len(rows)))))[0]
                found.append(Cell(part, rests, as_slice(rows), own))
    lengths = slice(3 * N, 3 * N + DISTANCES)
    return [*found, Cell(2, np.empty(0, np.int64), lengths, np.zeros((DISTANCES, 0)))]


def test_a_cell_sees_the_columns_that_are_not_zero_there() -> None:
    columns, of = full(), ArtefactColumns(NUMBERS, to_blocks([full()], PLACEMENT))
    for cell in cells():
        numbers, values = of.columns_in(cell)
        rows = columns[cell.rows]
        here = np.flatnonzero(np.isin(NUMBERS, numbers))
        assert values == pytest.approx(rows[:, here])
        assert (np.delete(rows, here, axis=1) == 0.0).all()
    assert [len(of.columns_in(cell)[0]) for cell in cells()] == [4, 3, 3, 4, 3, 3, 1]


def test_products_within_each_candidate_add_up_over_the_cells() -> None:
    columns, of = full(), ArtefactColumns(NUMBERS, to_blocks([full()], PLACEMENT))
    gram = np.zeros((len(CANDIDATES), 2, 2))
    for cell in cells():
        of.add_products(cell, CANDIDATES, gram)
    for i, numbers in enumerate(CANDIDATES):
        own = columns[:, np.isin(NUMBERS, numbers)]
        expected = own.T @ own if own.size else np.zeros((2, 2))
        assert gram[i] == pytest.approx(expected, abs=1e-12)


def test_clear_of_a_cells_own_columns_is_what_least_squares_leaves() -> None:
    white = np.random.default_rng(3).normal(size=(3 * N + DISTANCES, 4))
    before = white.copy()
    found = clear_columns(white, cells())
    assert (white == before).all()
    for cell in cells():
        rows, own = white[cell.rows], cell.absorbing
        left = rows - own @ np.linalg.lstsq(own, rows)[0] if own.shape[1] else rows
        assert found[cell.rows] == pytest.approx(left, abs=1e-12)


def test_parts_of_a_placement_are_told_apart_and_together_are_all() -> None:
    columns = full()
    again = np.zeros((N, 3, len(WHERE)))
    seen = []
    for part, piece in split_by_part(to_blocks([columns], PLACEMENT), PART):
        assert (PART[piece.rests] == part).all() and len(set(PLACEMENT[piece.rests])) == 1
        assert piece.values.any(axis=(0, 1)).all()  # no column that is zero there
        again[np.ix_(piece.rests, np.arange(3), piece.columns)] = piece.values
        seen.append((part, int(PLACEMENT[piece.rests[0]])))
    assert again.reshape(3 * N, -1) == pytest.approx(columns[: 3 * N])
    assert sorted(seen) == sorted(set(zip(PART.tolist(), PLACEMENT.tolist(), strict=True)))


def test_a_run_of_rows_is_a_slice_and_what_has_gaps_is_none() -> None:
    assert list_rows(np.array([1, 3])).tolist() == [3, 4, 5, 9, 10, 11]
    assert as_slice(list_rows(np.array([2, 3]))) == slice(6, 12)
    for rows in (list_rows(np.array([1, 3])), np.array([5, 4, 3]), np.empty(0, np.int64)):
        assert as_slice(rows) is rows

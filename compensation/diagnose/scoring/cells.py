"""The rests of one placement in one part of the data, and what absorbs only there."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.estimate.linear.blocks import Blocks, Piece


@dataclass(frozen=True)
class Cell:
    """The rests of one placement in one part, and what absorbs only there."""

    part: int
    rests: I64
    rows: slice | I64
    absorbing: F64  # (rows, l): absorbing @ absorbing.T projects whitened rows on what absorbs


@dataclass(frozen=True)
class ArtefactColumns:
    """Whitened candidates' columns that change the artefact; many are of one placement only.

    Such a candidate has no other columns.
    """

    columns: I64  # (c,) their numbers among all candidates', ascending
    white: Blocks  # of c columns

    def columns_in(self, cell: Cell) -> tuple[I64, F64]:
        """Return the numbers of the columns that are not zero in a cell, and their values there
        (rows, ·).

        The numbers count all candidates' columns.
        """
        indices, rows = self._indices_in(cell)
        return self.columns[indices], rows

    def add_products(self, cell: Cell, candidates: I64, gram: F64) -> None:
        """Add to *gram* (C, m, m) the products in a cell within candidates.

        *candidates* (C, m): the numbers of their columns.
        """
        indices, rows = self._indices_in(cell)
        numbers = self.columns[indices]
        begin = np.searchsorted(numbers, candidates[:, 0])
        end = np.searchsorted(numbers, candidates[:, -1] + 1)
        for i in np.flatnonzero(end > begin):
            span = slice(begin[i], end[i])
            positions = numbers[span] - candidates[i, 0]
            gram[i][np.ix_(positions, positions)] += rows[:, span].T @ rows[:, span]

    def _indices_in(self, cell: Cell) -> tuple[I64, F64]:
        if len(cell.rests):
            piece = self.white.select_rests(cell.rests)
            return piece.columns, to_rows(piece.values)
        indices = np.flatnonzero(self.white.distances.any(axis=0))
        return indices, self.white.distances[:, indices]


def to_rows(values: F64) -> F64:
    """Reshape values (k, 3, c) to rows (3 k, c)."""
    k, axes, c = values.shape
    return values.reshape(k * axes, c)


def split_by_part(white: Blocks, part_of: I64) -> Iterator[tuple[int, Piece]]:
    """Split each placement's rests by the part (n,) of the data that they belong to."""
    for piece in white.pieces:
        for part in np.unique(part_of[piece.rests]):
            is_in_part = part_of[piece.rests] == part
            nonzero = piece.values[is_in_part].any(axis=(0, 1))
            values = piece.values[is_in_part][:, :, nonzero]
            yield int(part), Piece(piece.rests[is_in_part], piece.columns[nonzero], values)


def clear_columns(white: F64, cells: Sequence[Cell]) -> F64:
    """Clear whitened columns (N, m) of what the cells' own columns absorb."""
    remaining = white.copy()
    for cell in cells:
        remaining[cell.rows] -= cell.absorbing @ (cell.absorbing.T @ white[cell.rows])
    return remaining


def compute_products_of_parts(
    white: F64, cleared: F64, cells: Sequence[Cell], parts: int
) -> tuple[F64, F64]:
    """Return the products (parts, m, u) of whitened columns (N, m) with *cleared* ones (N, u).

    The squared lengths (parts, m) of the whitened columns are returned with them.
    """
    products = np.zeros((parts, white.shape[1], cleared.shape[1]))
    squared_lengths = np.zeros((parts, white.shape[1]))
    for cell in cells:
        rows = white[cell.rows]
        products[cell.part] += rows.T @ cleared[cell.rows]
        squared_lengths[cell.part] += (rows**2).sum(axis=0)
    return products, squared_lengths


def list_rows(rests: I64) -> I64:
    """Return the three rows (3 k,) of each of rests (k,)."""
    return (3 * rests[:, None] + np.arange(3)).ravel()


def as_slice(rows: I64) -> slice | I64:
    """Return consecutive numbers as a slice, which copies nothing; others unchanged."""
    if len(rows) and rows[-1] - rows[0] + 1 == len(rows) and (np.diff(rows) == 1).all():
        return slice(int(rows[0]), int(rows[-1]) + 1)
    return rows

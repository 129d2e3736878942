"""Tall columns stored placement by placement: most are zero in all placements but one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from armd.arrays import F64, I64, Mask
from armd.compensation.data.in_order import run_in_order
from armd.compensation.estimate.linear.bordered import compute_pseudo_inverse_factor


@dataclass(frozen=True)
class Piece:
    """The nonzero columns at one placement's rests (k,).

    *columns* (c,) are their numbers, ascending; *values* (k, 3, c).
    """

    rests: I64
    columns: I64
    values: F64


@dataclass(frozen=True)
class Blocks:
    """Columns (N, m) over n rests and D certified distances, N = 3 n + D."""

    n: int
    size: int  # m
    pieces: tuple[Piece, ...]
    distances: F64  # (D, m)

    def products(self, whitener: F64, distance_mm: F64, residual: F64) -> F64:
        """Return products (m + 1, m + 1) of the columns, with a residual (N,) as the last one.

        Rows are whitened by matrices (n, 3, 3) and standard uncertainties (D,).
        """
        n = 3 * self.n
        last = np.hstack([self.distances, residual[n:, None]]) / distance_mm[:, None]
        total: F64 = last.T @ last
        by_rest = residual[:n].reshape(-1, 3, 1)

        def multiply(piece: Piece) -> F64:
            columns = np.concatenate([piece.values, by_rest[piece.rests]], axis=2)
            white = (whitener[piece.rests] @ columns).reshape(-1, columns.shape[2])
            product: F64 = white.T @ white
            return product

        for piece, product in zip(self.pieces, run_in_order(multiply, self.pieces), strict=True):
            numbers = np.append(piece.columns, self.size)
            total[np.ix_(numbers, numbers)] += product
        return total

    def compute_products_clear_of(
        self,
        eliminated: Mask,
        variance: F64,
        whitener: F64,
        distance_mm: F64,
        residual: F64,
        left_out: Sequence[Mask],
    ) -> list[tuple[F64, F64]]:
        """Return products of all columns but those *eliminated* (m,), which are fitted along.

        Each eliminated column is in one of the pieces. The products are as in `products`; with them
        are returned the squared lengths of these columns before elimination. Both are computed
        without the rests of each of *left_out* (n,). These do not overlap, so rows are multiplied
        only once.

        *variance* (m,): of the amplitudes a priori, inf: free. A direction of the eliminated
        columns that neither rows nor priors determine takes nothing.
        """
        shared = np.flatnonzero(~eliminated)
        turn = np.empty(self.size, dtype=np.int64)
        turn[shared] = np.arange(len(shared))
        n = 3 * self.n
        last = np.hstack([self.distances[:, shared], residual[n:, None]]) / distance_mm[:, None]
        certified: F64 = last.T @ last
        results = [(certified.copy(), np.diag(certified)[:-1].copy()) for _ in left_out]
        by_rest = residual[:n].reshape(-1, 3, 1)
        part_of = np.full(self.n, -1)
        for part, out in enumerate(left_out):
            part_of[out] = part

        def clear_each(piece: Piece) -> list[tuple[F64, F64] | None]:
            is_eliminated = eliminated[piece.columns]
            order = np.concatenate([np.flatnonzero(is_eliminated), np.flatnonzero(~is_eliminated)])
            columns = np.concatenate([piece.values[:, :, order], by_rest[piece.rests]], axis=2)
            white, parts = whitener[piece.rests] @ columns, part_of[piece.rests]
            grams = {
                int(part): _multiply_columns(white[parts == part]) for part in np.unique(parts)
            }
            priors = 1.0 / variance[piece.columns[is_eliminated]]
            by_parts: dict[tuple[int, ...], tuple[F64, F64] | None] = {(): None}
            remaining_parts = [
                tuple(p for p in grams if p != part) for part in range(len(left_out))
            ]
            for parts_left in remaining_parts:
                if parts_left not in by_parts:
                    by_parts[parts_left] = _eliminate_first(
                        np.sum([grams[p] for p in parts_left], axis=0), priors
                    )
            return [by_parts[parts_left] for parts_left in remaining_parts]

        for piece, of_parts in zip(self.pieces, run_in_order(clear_each, self.pieces), strict=True):
            numbers = np.append(turn[piece.columns[~eliminated[piece.columns]]], len(shared))
            for (products, squared_lengths), addition in zip(results, of_parts, strict=True):
                if addition is not None:
                    products[np.ix_(numbers, numbers)] += addition[0]
                    squared_lengths[numbers[:-1]] += addition[1]
        return results

    @cached_property
    def meeting(self) -> Mask:
        """The pairs of columns (m, m) that are in one piece, or of one distance, together."""
        together = self.distances != 0.0
        meets: Mask = together.T @ together
        for piece in self.pieces:
            meets[np.ix_(piece.columns, piece.columns)] = True
        return meets

    @cached_property
    def in_one_piece(self) -> Mask:
        """The columns (m,) that are zero outside one piece."""
        count = np.zeros(self.size, dtype=np.int64)
        for piece in self.pieces:
            count[piece.columns] += 1
        is_single: Mask = (count <= 1) & ~self.distances.any(axis=0)
        return is_single

    def whitened(self, whitener: F64, distance_mm: F64) -> Blocks:
        """Return the columns whitened by matrices (n, 3, 3) and standard uncertainties (D,)."""
        pieces = (replace(p, values=whitener[p.rests] @ p.values) for p in self.pieces)
        return replace(self, pieces=tuple(pieces), distances=self.distances / distance_mm[:, None])

    def select_rests(self, rests: I64) -> Piece:
        """Return the columns at some rests of one placement, ascending."""
        piece = self.pieces[int(self._number[rests[0]])]
        return replace(piece, rests=rests, values=piece.values[np.searchsorted(piece.rests, rests)])

    @cached_property
    def _number(self) -> I64:
        """The number (n,) of each rest's piece."""
        numbers = np.empty(self.n, dtype=np.int64)
        for k, piece in enumerate(self.pieces):
            numbers[piece.rests] = k
        return numbers

    def times(self, amplitudes: F64) -> F64:
        """Return the columns times amplitudes (m, …), as (N, …)."""
        sets = amplitudes.shape[1:]
        at_rests = np.zeros((self.n, 3, *sets))
        for piece in self.pieces:
            at_rests[piece.rests] = piece.values @ amplitudes[piece.columns]
        by_row = at_rests.reshape(3 * self.n, *sets)
        return np.concatenate([by_row, self.distances @ amplitudes])

    def across(self, columns: F64) -> F64:
        """Return products (m, …) with other columns (N, …)."""
        flat = columns[:, None] if columns.ndim == 1 else columns
        products: F64 = self.distances.T @ flat[3 * self.n :]
        by_rest = flat[: 3 * self.n].reshape(self.n, 3, flat.shape[1])
        for piece in self.pieces:
            rows = piece.values.reshape(3 * len(piece.rests), len(piece.columns))
            products[piece.columns] += rows.T @ by_rest[piece.rests].reshape(
                len(rows), flat.shape[1]
            )
        return products.reshape(self.size, *columns.shape[1:])

    def only(self, numbers: I64 | slice) -> Blocks:
        """Return some of the columns, in their order."""
        chosen = np.arange(self.size)[numbers]
        if np.array_equal(chosen, np.arange(self.size)):
            return self
        turn = np.full(self.size, -1)
        turn[chosen] = np.arange(len(chosen))
        pieces = []
        for piece in self.pieces:
            is_chosen = turn[piece.columns] >= 0
            pieces.append(
                Piece(piece.rests, turn[piece.columns[is_chosen]], piece.values[:, :, is_chosen])
            )
        return Blocks(self.n, len(chosen), tuple(pieces), self.distances[:, chosen])

    def to_dense(self, numbers: I64 | slice = slice(None)) -> F64:
        """Return some of the columns in full (N, …)."""
        chosen = self.only(numbers)
        rows = np.zeros((3 * self.n + len(self.distances), chosen.size))
        at_rests = rows[: 3 * self.n].reshape(self.n, 3, chosen.size)
        for piece in chosen.pieces:
            at_rests[piece.rests[:, None, None], np.arange(3)[:, None], piece.columns] = (
                piece.values
            )
        rows[3 * self.n :] = chosen.distances
        return rows

    def replace_columns(self, place: slice, columns: Sequence[F64]) -> Blocks:
        """Put other *columns* (N, …) in the place of those at *place*."""
        return _join([self.only(slice(place.start)), *columns, self.only(slice(place.stop, None))])

    @cached_property
    def independent_groups(self) -> tuple[tuple[I64, F64], ...]:
        """The groups of rests that can be solved separately, as placements that share no column.

        Of each group: rests (k,), and the values (k, 3, c) of the columns there.
        """
        count = len(self.pieces)
        ends = [(k, count + j) for k, piece in enumerate(self.pieces) for j in piece.columns]
        k, j = np.array(ends, dtype=np.int64).reshape(-1, 2).T
        links = coo_array((np.ones(len(k)), (k, j)), shape=2 * (count + self.size,))
        label = connected_components(links, directed=False)[1]
        turn = np.zeros(self.size, dtype=np.int64)
        solvable = []
        for group in np.unique(label[:count]):
            columns = np.flatnonzero(label[count:] == group)
            turn[columns] = np.arange(len(columns))
            together = [self.pieces[k] for k in np.flatnonzero(label[:count] == group)]
            of_pieces = []
            for piece in together:
                values = np.zeros((len(piece.rests), 3, len(columns)))
                values[:, :, turn[piece.columns]] = piece.values
                of_pieces.append(values)
            rests = np.concatenate([piece.rests for piece in together])
            solvable.append((rests, np.concatenate(of_pieces)))
        return tuple(solvable)


def to_blocks(columns: Sequence[F64 | Blocks], placement: I64) -> Blocks:
    """Store columns (3 n + D, …), m in all, by the *placement* (n,) of each rest.

    If some are in blocks already, all are stored in these blocks.
    """
    n = len(placement)
    if any(isinstance(block, Blocks) for block in columns):
        return _join(columns)
    rests = [np.flatnonzero(placement == number) for number in np.unique(placement)]
    none = tuple(
        Piece(piece_rests, np.empty(0, np.int64), np.empty((len(piece_rests), 3, 0)))
        for piece_rests in rests
    )
    distances = max(block.shape[0] for block in columns if not isinstance(block, Blocks)) - 3 * n
    return _join([Blocks(n, 0, none, np.empty((distances, 0))), *columns])


def _join(columns: Sequence[F64 | Blocks]) -> Blocks:
    """Join all columns side by side; at least one of them is in blocks."""
    blocks = next(block for block in columns if isinstance(block, Blocks))
    n = blocks.n
    sizes = [block.size if isinstance(block, Blocks) else block.shape[1] for block in columns]
    first = np.cumsum([0, *sizes])
    at_rests = [
        block if isinstance(block, Blocks) else block[: 3 * n].reshape(n, 3, block.shape[1])
        for block in columns
    ]
    pieces = []
    for k, piece in enumerate(blocks.pieces):
        numbers, values = [], []
        for begin, block in zip(first[:-1], at_rests, strict=True):
            if isinstance(block, Blocks):
                numbers.append(begin + block.pieces[k].columns)
                values.append(block.pieces[k].values)
            elif block.shape[2]:
                piece_values = block[piece.rests]
                nonzero = np.flatnonzero(piece_values.any(axis=(0, 1)))
                numbers.append(begin + nonzero)
                values.append(piece_values[:, :, nonzero])
        pieces.append(Piece(piece.rests, np.concatenate(numbers), np.concatenate(values, axis=2)))
    distances = [
        block.distances if isinstance(block, Blocks) else block[3 * n :] for block in columns
    ]
    return Blocks(n, int(first[-1]), tuple(pieces), np.hstack(distances))


def _multiply_columns(white: F64) -> F64:
    """Return products (c, c) of columns (k, 3, c)."""
    rows = white.reshape(-1, white.shape[2])
    gram: F64 = rows.T @ rows
    return gram


def _eliminate_first(gram: F64, priors: F64) -> tuple[F64, F64]:
    """Eliminate the first m columns, which have *priors* (m,), from the products of all.

    Returns the products of the others, and their squared lengths before, except the last one's.
    """
    m = len(priors)
    first_gram = gram[:m, :m] + np.diag(priors)
    projected = compute_pseudo_inverse_factor(first_gram).T @ gram[:m, m:]
    within = gram[m:, m:]
    return within - projected.T @ projected, np.diag(within)[:-1]

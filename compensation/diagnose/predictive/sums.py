"""Sums of values at the rests over each variable's features and bins, all variables at once."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.sparse import csc_array, csr_array, vstack

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import MOST_TOGETHER
from armd.compensation.diagnose.predictive.bins import Bins


@dataclass(frozen=True)
class Functions:
    """The features and bins of one variable over which values are summed."""

    columns: F64  # (n, m) features; 0 where the variable's value is missing
    is_in: csr_array  # (B, n) rests of each bin, as a matrix: multiplying is faster than adding
    is_together: bool = True  # False: many bins, which count as independent

    @classmethod
    def from_columns(cls, columns: F64) -> Functions:
        """Make functions from *columns* (n, m) alone, without bins."""
        return cls(columns, csr_array((0, len(columns))))

    @classmethod
    def from_features(cls, features: F64, bins: Bins, rests: int) -> Functions:
        """Make functions from *features* (k, m) of the rests in the bins' order, and from the bins.

        Where there are many bins, the features are dropped.
        """
        is_together = features.shape[1] + len(bins.starts) <= MOST_TOGETHER
        columns = np.zeros((rests, features.shape[1] * is_together))
        columns[bins.order] = features[:, : columns.shape[1]]
        ends = np.append(bins.starts, len(bins.order))
        is_in = csr_array(
            (np.ones(len(bins.order)), bins.order, ends), shape=(len(bins.starts), rests)
        )
        return cls(columns, is_in, is_together)

    @property
    def count(self) -> int:
        """The number of columns."""
        return int(self.columns.shape[1])

    def sum_values(self, values: F64) -> F64:
        """Return sums (m + B, …) of values (n, …)."""
        return np.concatenate([self.columns.T @ values, self.is_in @ values])


@dataclass(frozen=True)
class SparseSums:
    """Sums over several variables' functions of values most of which are zero."""

    columns: F64  # (m, s) over all columns
    bins: csc_array  # (B, s) over all bins
    first_columns: I64  # of each variable but the first
    first_bins: I64

    def select(self, part: slice) -> F64:
        """Return the sums (m + B, ·) of some of the values."""
        return np.concatenate([self.columns[:, part], self.bins[:, part].toarray()])

    def split(self) -> Iterator[F64]:
        """Yield each variable's own sums (m + B, s)."""
        by_row = self.bins.tocsr()
        edges = [0, *self.first_bins.tolist(), by_row.shape[0]]
        by_column = np.split(self.columns, self.first_columns)
        for columns, (low, high) in zip(by_column, itertools.pairwise(edges), strict=True):
            yield np.concatenate([columns, by_row[low:high].toarray()])


class RestFunctions(Protocol):
    """Functions of the rests, over which values are summed."""

    def sum_at_piece(self, number: int, values: F64) -> F64:
        """Return (m, c) sums of values (k, c) at the rests of one piece, by its number."""

    def sum_sparse(self, values: csr_array) -> SparseSums:
        """Return sums of values (n, s)."""


@dataclass(frozen=True)
class ShapeSums:
    """Sums over shapes (m, n), given the rests (k,) of each piece."""

    shapes: F64
    pieces: Sequence[I64]

    def sum_at_piece(self, number: int, values: F64) -> F64:
        """Return (m, c) sums of values (k, c) at the rests of one piece, by its number."""
        sums: F64 = self.shapes[:, self.pieces[number]] @ values
        return sums

    def sum_sparse(self, values: csr_array) -> SparseSums:
        """Return sums of values (n, s)."""
        none = np.empty(0, np.int64)
        no_bins = csc_array((0, values.shape[1]))
        return SparseSums((values.T @ self.shapes.T).T, no_bins, none, none)


class FunctionSums:
    """Sums over the functions of several variables: all their columns, then all their bins."""

    def __init__(self, variables: Sequence[Functions], pieces: Sequence[I64]) -> None:
        """Take the functions of each variable, and the rests (k,) of each of *pieces*."""
        self.variables = variables
        self._columns = np.hstack([functions.columns for functions in variables])
        self._is_in = vstack([functions.is_in for functions in variables], format="csr")
        self._first_columns = np.cumsum([functions.count for functions in variables])[:-1]
        self._first_bins = np.cumsum([functions.is_in.shape[0] for functions in variables])[:-1]
        by_rest = self._is_in.T.tocsr()
        self._at_pieces = [(self._columns[rests].T, by_rest[rests].T.tocsr()) for rests in pieces]

    def sum_over_bins(self, values: F64) -> list[F64]:
        """Return each variable's sums (B, …) of values (n, …) over its bins."""
        return np.split(self._is_in @ values, self._first_bins)

    def sum_values(self, values: F64) -> F64:
        """Return (m, …) sums of values (n, …)."""
        return np.concatenate([self._columns.T @ values, self._is_in @ values])

    def sum_at_piece(self, number: int, values: F64) -> F64:
        """Return (m, c) sums of values (k, c) at the rests of one piece, by its number."""
        columns, is_in = self._at_pieces[number]
        return np.concatenate([columns @ values, is_in @ values])

    def sum_sparse(self, values: csr_array) -> SparseSums:
        """Return sums of values (n, s)."""
        over_bins = (self._is_in @ values).tocsc()
        over_columns = (values.T @ self._columns).T
        return SparseSums(over_columns, over_bins, self._first_columns, self._first_bins)

    def split(self, sums: F64) -> list[F64]:
        """Return each variable's own sums (m + B, …), of those (m, …) of all."""
        by_column = np.split(sums[: self._columns.shape[1]], self._first_columns)
        by_bin = np.split(sums[self._columns.shape[1] :], self._first_bins)
        return [*map(np.concatenate, zip(by_column, by_bin, strict=True))]

"""Sums of values at the rests over each variable's features and bins, all variables at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy.sparse import csr_array, vstack

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import MOST_TOGETHER
from armd.compensation.diagnose.predictive.bins import Bins


@dataclass(frozen=True)
class Functions:
    """What values are summed over together."""

    columns: F64  # (n, m) features; 0 where the variable's value is missing
    is_in: csr_array  # (B, n) which rests a bin holds: multiplying is faster than adding up
    is_together: bool = True  # else there are many bins, which count as independent

    @classmethod
    def from_columns(cls, columns: F64) -> Functions:
        """Of *columns* (n, m) alone."""
        return cls(columns, csr_array((0, len(columns))))

    @classmethod
    def from_features(cls, features: F64, bins: Bins, rests: int) -> Functions:
        """Of *features* (k, m) of the rests in the bins' order; none beside many bins."""
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
        """How many columns there are."""
        return int(self.columns.shape[1])

    def sum_values(self, values: F64) -> F64:
        """(m + B, …) sums of values (n, …)."""
        return np.concatenate([self.columns.T @ values, self.is_in @ values])


class RestFunctions(Protocol):
    """Sums of values over m functions of the rests."""

    def sum_at_all(self, values: F64 | csr_array) -> F64:
        """(m, …) of values (n, …)."""

    def sum_at_piece(self, number: int, values: F64) -> F64:
        """(m, c) of values (k, c) at the rests of one piece, by its number."""


@dataclass(frozen=True)
class ShapeSums:
    """Over shapes (m, n), the rests (k,) of each piece being given."""

    shapes: F64
    pieces: Sequence[I64]

    def sum_at_all(self, values: F64 | csr_array) -> F64:
        """(m, …) of values (n, …)."""
        return _multiply(self.shapes, values)

    def sum_at_piece(self, number: int, values: F64) -> F64:
        """(m, c) of values (k, c)."""
        sums: F64 = self.shapes[:, self.pieces[number]] @ values
        return sums


class FunctionSums:
    """Over the functions of several variables at once: all their columns, then all their bins."""

    def __init__(self, variables: Sequence[Functions], pieces: Sequence[I64]) -> None:
        """*pieces*: the rests (k,) of each."""
        self.variables = variables
        self._columns = np.hstack([functions.columns for functions in variables])
        self._is_in = vstack([functions.is_in for functions in variables], format="csr")
        self._first_columns = np.cumsum([functions.count for functions in variables])[:-1]
        self._first_bins = np.cumsum([functions.is_in.shape[0] for functions in variables])[:-1]
        by_rest = self._is_in.T.tocsr()
        self._at_pieces = [(self._columns[rests].T, by_rest[rests].T.tocsr()) for rests in pieces]

    def sum_over_bins(self, values: F64) -> list[F64]:
        """Of each variable (B, …) sums of values (n, …) over its bins."""
        return np.split(self._is_in @ values, self._first_bins)

    def sum_at_all(self, values: F64 | csr_array) -> F64:
        """(m, …) of values (n, …)."""
        at_bins = self._is_in @ values
        dense = at_bins.toarray() if isinstance(at_bins, csr_array) else at_bins
        return np.concatenate([_multiply(self._columns.T, values), dense])

    def sum_at_piece(self, number: int, values: F64) -> F64:
        """(m, c) of values (k, c)."""
        columns, is_in = self._at_pieces[number]
        return np.concatenate([columns @ values, is_in @ values])

    def divide(self, sums: F64) -> list[F64]:
        """Of each variable its own sums (m + B, …), of those (m, …) of all."""
        by_column = np.split(sums[: self._columns.shape[1]], self._first_columns)
        by_bin = np.split(sums[self._columns.shape[1] :], self._first_bins)
        return [*map(np.concatenate, zip(by_column, by_bin, strict=True))]


def _multiply(rows: F64, values: F64 | csr_array) -> F64:
    """Rows (m, n) times values (n, …), which may be sparse."""
    product: F64 = (values.T @ rows.T).T if isinstance(values, csr_array) else rows @ values
    return product

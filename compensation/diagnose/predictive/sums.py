"""Sums of values at the rests over each variable's features and bins, all variables at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array, vstack

from armd.arrays import F64
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


class FunctionSums:
    """Sums over the functions of several variables at once."""

    def __init__(self, variables: Sequence[Functions]) -> None:
        self.variables = variables
        self._columns = np.hstack([functions.columns for functions in variables])
        self._is_in = vstack([functions.is_in for functions in variables], format="csr")
        self._first_columns = np.cumsum([functions.count for functions in variables])[:-1]
        self._first_bins = np.cumsum([functions.is_in.shape[0] for functions in variables])[:-1]

    def sum_over_bins(self, values: F64) -> list[F64]:
        """Of each variable (B, …) sums of values (n, …) over its bins."""
        return np.split(self._is_in @ values, self._first_bins)

    def sum_values(self, values: F64) -> list[F64]:
        """Of each variable (m + B, …) sums of values (n, …) over its columns and its bins."""
        by_column = np.split(self._columns.T @ values, self._first_columns)
        return [*map(np.concatenate, zip(by_column, self.sum_over_bins(values), strict=True))]

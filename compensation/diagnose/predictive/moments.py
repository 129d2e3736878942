"""Sums of residuals over a variable's bins: measured, and how drawn sets scatter."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import MOST_TOGETHER, SETS_SHOWN


class Moments:
    """Of *components*, each by itself, second moments of sums over bins of the rests in *order*
    (k,), each from one of *starts* on."""

    def __init__(self, order: I64, starts: I64, rests: int, components: int) -> None:
        size = len(starts)
        ends = np.append(starts, len(order))
        # (B, n) which rests a bin holds: multiplying takes a fifth of picking and adding
        self._is_in = csr_array((np.ones(len(order)), order, ends), shape=(size, rests))
        self._together = size <= MOST_TOGETHER
        shape = (components, size, size) if self._together else (components, size)
        self._sum: F64 = np.zeros(shape)
        self._draws = np.zeros(components, dtype=np.int64)
        self.first_sums: F64 = np.zeros((components, size, SETS_SHOWN))  # sums of the first sets

    def sum_over_bins(self, values: F64) -> F64:
        """(B, …) sums over each bin of values (n, …)."""
        sums: F64 = self._is_in @ values
        return sums

    def add(self, component: int, along: F64) -> None:
        """Residuals (n, r) of drawn sets more."""
        sums = self.sum_over_bins(along)
        if not self._draws[component]:
            self.first_sums[component] = sums[:, :SETS_SHOWN]
        self._sum[component] += sums @ sums.T if self._together else (sums**2).sum(axis=1)
        self._draws[component] += sums.shape[1]

    @property
    def draws(self) -> int:
        return int(self._draws[0])

    def covariance(self, component: int) -> F64:
        """(B, B) of its sums; (B,) variances of too many bins."""
        covariance: F64 = self._sum[component] / self._draws[component]
        return covariance

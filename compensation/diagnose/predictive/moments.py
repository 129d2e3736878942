"""Sums of residuals over a variable's bins: measured, and how drawn sets scatter."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import MOST_TOGETHER, SETS_SHOWN


class Moments:
    """Second moments of sums over bins of the rests in *order* (k,)."""

    def __init__(self, order: I64, starts: I64) -> None:
        self._together = len(starts) <= MOST_TOGETHER
        self._order, self._starts = order, starts
        self._sum: F64 = np.zeros(0)
        self.shown: F64 = np.zeros(0)  # (K, B, SHOWN) sums of the first sets
        self.draws = 0

    def sums(self, along: F64) -> F64:
        """(K, B, r) of residuals (K, n, r)."""
        sums: F64 = np.add.reduceat(along[:, self._order], self._starts, axis=1)
        return sums

    def add(self, along: F64) -> None:
        """Residuals (K, n, r) of drawn sets more."""
        sums = self.sums(along)
        if not self.draws:
            self.shown = sums[:, :, :SETS_SHOWN].copy()
            self._sum = np.zeros(1)
        more = sums @ sums.transpose(0, 2, 1) if self._together else (sums**2).sum(axis=2)
        self._sum = self._sum + more
        self.draws += sums.shape[2]

    @property
    def covariance(self) -> F64:
        """(K, B, B) of each component's sums; (K, B) variances of too many bins."""
        return self._sum / self.draws

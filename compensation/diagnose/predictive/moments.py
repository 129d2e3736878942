"""Sums of residuals over a variable's features and bins: measured, and how drawn sets scatter."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import MOST_TOGETHER, SETS_SHOWN


class Moments:
    """Second moments of sums over features (k, m) and over bins of the rests in *order* (k,)."""

    def __init__(self, features: F64, order: I64, starts: I64) -> None:
        together = features.shape[1] + len(starts) <= MOST_TOGETHER
        self._features = features if together else features[:, :0]
        self._order, self._starts, self._together = order, starts, together
        self._sum: F64 = np.zeros(0)
        self.shown: F64 = np.zeros(0)  # (K, B, SHOWN) sums over the bins
        self.draws = 0

    @property
    def n_features(self) -> int:
        return len(self._features.T)

    def sums(self, along: F64) -> F64:
        """(K, m + B, r) of residuals (K, n, r)."""
        own = along[:, self._order]
        parts = [self._features.T @ own]
        if len(self._starts):
            parts.append(np.add.reduceat(own, self._starts, axis=1))
        return np.concatenate(parts, axis=1)

    def unabsorbed(self, square: F64) -> F64:
        """(K, m + B) variances of sums of rests whose own are *square* (K, n), independent."""
        own = square[:, self._order]
        parts = [own @ self._features**2]
        if len(self._starts):
            parts.append(np.add.reduceat(own, self._starts, axis=1))
        return np.concatenate(parts, axis=1)

    def add(self, along: F64) -> None:
        """Residuals (K, n, r) of drawn sets more."""
        sums = self.sums(along)
        if not self.draws:
            self.shown = sums[:, self.n_features :, :SETS_SHOWN].copy()
            self._sum = np.zeros(1)
        more = sums @ sums.transpose(0, 2, 1) if self._together else (sums**2).sum(axis=2)
        self._sum = self._sum + more
        self.draws += sums.shape[2]

    @property
    def covariance(self) -> F64:
        """(K, m + B, m + B) of each component's sums; (K, B) variances of too many bins."""
        return self._sum / self.draws

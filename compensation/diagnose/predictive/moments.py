"""How sums over a variable's bins scatter among drawn sets."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import MOST_TOGETHER, SETS_SHOWN


class Moments:
    """Of *components*, each by itself, second moments of sums over *size* bins."""

    def __init__(self, size: int, components: int) -> None:
        self._together = size <= MOST_TOGETHER
        shape = (components, size, size) if self._together else (components, size)
        self._sum: F64 = np.zeros(shape)
        self._draws = np.zeros(components, dtype=np.int64)
        self.first_sums: F64 = np.zeros((components, size, SETS_SHOWN))  # sums of the first sets

    def add(self, component: int, sums: F64) -> None:
        """Sums (B, r) over the bins of drawn sets more."""
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

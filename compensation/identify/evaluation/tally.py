"""Statistics of any number of distances, without keeping them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from armd.arrays import F64, I64

#: Bins in an octave: a median is accurate to a 65 000th of itself.
BINS = 1 << 16
LEAST_UM, OCTAVES = 2.0**-20, 64
#: the statistics of no distances
NONE: dict[str, Any] = {
    "rms_um": None, "max_um": None, "mean_um": None, "median_um": None, "n": 0,
}  # fmt: skip


class ErrorTally:
    """The root mean square, mean, maximum and median of distances in µm."""

    def __init__(self) -> None:
        self.n = 0
        self._sum, self._squares, self._largest_um = 0.0, 0.0, 0.0
        self._bins: I64 = np.zeros(0, np.int64)  # by the binary logarithm; as many as are needed

    def add(self, distance_um: F64) -> None:
        if not len(distance_um):
            return
        self.n += len(distance_um)
        self._sum += float(distance_um.sum())
        self._squares += float((distance_um**2).sum())
        self._largest_um = max(self._largest_um, float(distance_um.max()))
        octave = np.log2(np.clip(distance_um / LEAST_UM, 1.0, 2.0**OCTAVES))
        bins = (octave * BINS).astype(np.int64)
        self._reach(int(bins.max()) + 1)
        np.add.at(self._bins, bins, 1)  # not all bins: there are more of them than distances

    @classmethod
    def merge(cls, parts: Sequence[ErrorTally]) -> ErrorTally:
        total = cls()
        for part in parts:
            total.n += part.n
            total._sum += part._sum
            total._squares += part._squares
            total._largest_um = max(total._largest_um, part._largest_um)
            total._reach(len(part._bins))
            total._bins[: len(part._bins)] += part._bins
        return total

    def as_json(self) -> dict[str, Any]:
        """Return the object that `evaluate` gives for distances in memory."""
        if not self.n:
            return dict(NONE)
        return {
            "rms_um": math.sqrt(self._squares / self.n),
            "max_um": self._largest_um,
            "mean_um": self._sum / self.n,
            "median_um": self._median_um(),
            "n": self.n,
        }

    def _reach(self, bins: int) -> None:
        """Extend the bins to at least this many."""
        if bins > len(self._bins):
            self._bins = np.append(self._bins, np.zeros(bins - len(self._bins), np.int64))

    def _median_um(self) -> float:
        """Return the mean of the two middle distances, interpolated within their bins."""
        upto = np.cumsum(self._bins)
        middle = [
            self._find_rank_um(upto, (self.n - 1) // 2),
            self._find_rank_um(upto, self.n // 2),
        ]
        return sum(middle) / 2

    def _find_rank_um(self, upto: I64, rank: int) -> float:
        bin_ = int(np.searchsorted(upto, rank, side="right"))
        within = (rank - (upto[bin_] - self._bins[bin_]) + 0.5) / self._bins[bin_]
        octaves = float((bin_ + within) / BINS)
        return min(LEAST_UM * math.exp2(octaves), self._largest_um)

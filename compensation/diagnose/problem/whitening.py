"""The noise of the rests as a value: it whitens rows; and columns whose amplitudes it shares."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.estimate.linear.blocks import Blocks
from armd.compensation.estimate.postures import counts_as


@dataclass(frozen=True)
class Nuisance:
    """Columns (N, b) that explain for themselves, each amplitude normal with a variance.

    Infinite: it absorbs freely. NaN: the slow drift's, which the noise estimate fills in.
    """

    columns: Blocks
    variance: F64

    def ridged(self, noise: RestNoise) -> Nuisance:
        """With the drift's variance filled in."""
        variance = np.where(np.isnan(self.variance), noise.drift_mm**2, self.variance)
        return Nuisance(self.columns, np.maximum(variance, 1e-14))


@dataclass(frozen=True)
class RestNoise:
    """Estimated variances, and a whitening of the part that is independent between rests."""

    scale_mm: float  # s
    encoder_share: float  # ρ
    drift_mm: float  # standard deviation of what the slow drift changes from knot to knot
    encoder_rad: float
    repeat_mm: float
    whitener: F64  # (n, 3, 3): applied to a rest's residual gives unit variance
    distance_mm: F64  # (D,) standard uncertainties of the certified lengths
    #: (n,) how much each rest counts: copies of a posture share their error to this part; the
    #: whitener has the root of it
    counts: F64 = field(default_factory=lambda: np.ones(1))
    shared_part: float = 1.0
    settled: bool = True  # whether the search for the likeliest scale ended

    def sources(self, joints: F64) -> F64:
        """How rests in units of their noise move (n, 3, N + 3) with what makes it: the encoders,
        by *joints* (n, 3, N) mm/rad, and the repeat of a point."""
        repeat = np.broadcast_to(self.repeat_mm * np.eye(3), (len(joints), 3, 3))
        moves = np.concatenate([self.encoder_rad * joints, repeat], axis=2)
        white: F64 = self.whitener @ moves / np.sqrt(self.counts)[:, None, None]
        return white

    @property
    def own_mm(self) -> float:
        """3-D RMS of what is each rest's own, in mm."""
        covariance = np.linalg.inv(self.whitener) * np.sqrt(self.counts)[:, None, None]
        return float(np.sqrt((covariance**2).sum(axis=(1, 2)).mean()))

    def whiten_rests(self, moves: F64) -> F64:
        """Of each rest (n, 3) in units of its own noise."""
        white: F64 = np.einsum("nij,nj->ni", self.whitener, moves)
        return white / np.sqrt(self.counts)[:, None]

    def with_shared_part(self, part: float, posture: I64) -> RestNoise:
        """Return the same with copies of each *posture* (n,) sharing their error to a *part*."""
        counts = counts_as(posture, part)
        whitener = self.whitener * np.sqrt(counts / self.counts)[:, None, None]
        return replace(self, whitener=whitener, counts=counts, shared_part=part)

    def whiten(self, columns: F64) -> F64:
        """Rows (N,) or (N, m) in units of their own noise."""
        n = len(self.whitener)
        flat = columns.reshape(len(columns), -1)
        white = np.empty_like(flat)
        white[: 3 * n] = (self.whitener @ flat[: 3 * n].reshape(n, 3, -1)).reshape(3 * n, -1)
        white[3 * n :] = flat[3 * n :] / self.distance_mm[:, None]
        return white.reshape(columns.shape)

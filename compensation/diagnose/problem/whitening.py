"""The noise of the rests as a value: it whitens rows; and columns whose amplitudes it shares."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field, replace

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.diagnose.constants import AXES, LEAST_VARIANCE_MM2, ROUNDING, TURN_RATIOS
from armd.compensation.estimate.linear.blocks import Blocks
from armd.compensation.estimate.noise.postures import compute_counts
from armd.compensation.estimate.noise.robust import compute_edge_stretch, to_three_components
from armd.compensation.estimate.surfaces import project_on_normals


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
        return Nuisance(self.columns, np.maximum(variance, LEAST_VARIANCE_MM2))


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
    _: KW_ONLY
    #: (n,) how much each rest counts: copies of a posture share their error to this part; the
    #: whitener has the root of it
    counts: F64 = field(default_factory=lambda: np.ones(1))
    shared_part: float = 1.0
    settled: bool = True  # whether the search for the likeliest scale ended
    normal: F64 | None = None  # (n, 3) as `Linear` has them
    turned: Mask | None = None  # (n,) orientations; None: points alone
    turn_ratio: float = 1.0  # standard deviation of an orientation, at its lever, over the scale

    def sources(self, joints: F64) -> F64:
        """How rests in units of their noise move (n, 3, N + 3) with what makes it: the encoders,
        by *joints* (n, 3, N) mm/rad, and the repeat of a point."""
        own_mm = np.full(len(joints), self.repeat_mm)
        if self.turned is not None:
            own_mm[self.turned] = self.turn_ratio * self.scale_mm
        repeat = own_mm[:, None, None] * np.eye(3)
        if self.normal is not None:
            repeat = project_on_normals(self.normal, repeat)
        moves = np.concatenate([self.encoder_rad * joints, repeat], axis=2)
        white: F64 = self.whitener @ moves / np.sqrt(self.counts)[:, None, None]
        return white

    @property
    def own_mm(self) -> float:
        """3-D RMS of what is each point's own, in mm."""
        squares = np.square(self.roots).sum(axis=(1, 2))
        return float(np.sqrt(squares[self.points].mean()))

    @property
    def points(self) -> Mask | slice:
        """Which rests are points."""
        return slice(None) if self.turned is None else ~self.turned

    @property
    def roots(self) -> F64:
        """(n, 3, 3) with which unit variances make what is each rest's own, in mm."""
        roots: F64 = np.asarray(np.linalg.inv(self.whitener), dtype=np.float64)
        roots = roots * np.sqrt(self.counts)[:, None, None]
        return roots if self.normal is None else project_on_normals(self.normal, roots)

    @property
    def freedom(self) -> I64:
        """(n,) how many equations each rest gives."""
        if self.normal is None:
            return np.full(len(self.whitener), AXES)
        return np.where(self.normal.any(axis=1), 1, AXES)

    def squares(self, moves: F64) -> F64:
        """(n,) of rests (n, 3) in units of their own noise, as of three components each."""
        total = (self.whiten_rests(moves) ** 2).sum(axis=1)
        return total if self.normal is None else to_three_components(total, self.freedom)

    @property
    def stretch(self) -> F64 | float:
        """By what distances of rests (n,) are multiplied to be clipped at one edge."""
        return 1.0 if self.normal is None else compute_edge_stretch(self.freedom)

    def whiten_rests(self, moves: F64) -> F64:
        """Of each rest (n, 3) in units of its own noise."""
        white: F64 = np.einsum("nij,nj->ni", self.whitener, moves)
        return white / np.sqrt(self.counts)[:, None]

    def with_shared_part(self, part: float, posture: I64) -> RestNoise:
        """Return the same with copies of each *posture* (n,) sharing their error to a *part*."""
        counts = compute_counts(posture, part)
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


def compute_turn_ratio(residual: F64, turned: Mask) -> float:
    """How much farther off orientations are than points, by the middle ones of a residual (N,)."""
    if not turned.any():
        return 1.0
    off = np.linalg.norm(residual[: 3 * len(turned)].reshape(-1, 3), axis=1)
    ratio = float(np.median(off[turned])) / max(float(np.median(off[~turned])), ROUNDING)
    return float(np.clip(ratio, *TURN_RATIOS))

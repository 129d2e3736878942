"""The noise of the rests as a value, which whitens rows; nuisance columns with priors."""

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
    """Nuisance columns (N, b), each amplitude normal with a variance.

    Infinite: it absorbs freely. NaN: the slow drift's, which the noise estimate fills in.
    """

    columns: Blocks
    variance: F64

    def ridged(self, noise: RestNoise) -> Nuisance:
        """Return the nuisance with the drift's variance filled in."""
        variance = np.where(np.isnan(self.variance), noise.drift_mm**2, self.variance)
        return Nuisance(self.columns, np.maximum(variance, LEAST_VARIANCE_MM2))


@dataclass(frozen=True)
class RestNoise:
    """Estimated variances, and a whitening of the part that is independent between rests."""

    scale_mm: float  # s
    encoder_share: float  # ρ
    drift_mm: float  # standard deviation of the slow drift's change from knot to knot
    encoder_rad: float
    repeat_mm: float
    whitener: F64  # (n, 3, 3): applied to a rest's residual gives unit variance
    distance_mm: F64  # (D,) standard uncertainties of the certified lengths
    _: KW_ONLY
    #: (n,) weight of each rest, less than 1 for copies of a posture, which share their error to
    #: `shared_part`; the whitener contains the root of this weight
    counts: F64 = field(default_factory=lambda: np.ones(1))
    shared_part: float = 1.0
    settled: bool = True  # whether the search for the likeliest scale ended
    normal: F64 | None = None  # (n, 3) as `Linear` has them
    turned: Mask | None = None  # (n,) orientations; None: points alone
    turn_ratio: float = 1.0  # standard deviation of an orientation, at its lever, over the scale

    def sources(self, joints: F64) -> F64:
        """Return how noise sources of unit variance move each rest (n, 3, N + 3), whitened.

        Sources are the encoders, by *joints* (n, 3, N) mm/rad, and the repeat of a point.
        """
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
        """The 3-D RMS of each point's own noise, in mm."""
        squares = np.square(self.roots).sum(axis=(1, 2))
        return float(np.sqrt(squares[self.points].mean()))

    @property
    def points(self) -> Mask | slice:
        """The selection of those rests that are points."""
        return slice(None) if self.turned is None else ~self.turned

    @property
    def roots(self) -> F64:
        """The matrices (n, 3, 3) that turn unit variances into each rest's own noise, in mm."""
        roots: F64 = np.asarray(np.linalg.inv(self.whitener), dtype=np.float64)
        roots = roots * np.sqrt(self.counts)[:, None, None]
        return roots if self.normal is None else project_on_normals(self.normal, roots)

    @property
    def freedom(self) -> I64:
        """The number (n,) of equations that each rest gives."""
        if self.normal is None:
            return np.full(len(self.whitener), AXES)
        return np.where(self.normal.any(axis=1), 1, AXES)

    def squares(self, moves: F64) -> F64:
        """Return squared norms (n,) of *moves* (n, 3), whitened, as of three components each."""
        total = (self.whiten_rests(moves) ** 2).sum(axis=1)
        return total if self.normal is None else to_three_components(total, self.freedom)

    @property
    def stretch(self) -> F64 | float:
        """The factors (n,) on distances of rests by which one limit clips all of them."""
        return 1.0 if self.normal is None else compute_edge_stretch(self.freedom)

    def whiten_rests(self, moves: F64) -> F64:
        """Return *moves* (n, 3) of each rest in units of its own noise."""
        white: F64 = np.einsum("nij,nj->ni", self.whitener, moves)
        return white / np.sqrt(self.counts)[:, None]

    def with_shared_part(self, part: float, posture: I64) -> RestNoise:
        """Return the noise with copies of each *posture* (n,) sharing their error to a *part*."""
        counts = compute_counts(posture, part)
        whitener = self.whitener * np.sqrt(counts / self.counts)[:, None, None]
        return replace(self, whitener=whitener, counts=counts, shared_part=part)

    def whiten(self, columns: F64) -> F64:
        """Return rows (N,) or (N, m) in units of their own noise."""
        n = len(self.whitener)
        flat = columns.reshape(len(columns), -1)
        white = np.empty_like(flat)
        white[: 3 * n] = (self.whitener @ flat[: 3 * n].reshape(n, 3, -1)).reshape(3 * n, -1)
        white[3 * n :] = flat[3 * n :] / self.distance_mm[:, None]
        return white.reshape(columns.shape)


def compute_turn_ratio(residual: F64, turned: Mask) -> float:
    """Return the ratio of orientations' to points' median size in a *residual* (N,)."""
    if not turned.any():
        return 1.0
    off = np.linalg.norm(residual[: 3 * len(turned)].reshape(-1, 3), axis=1)
    ratio = float(np.median(off[turned])) / max(float(np.median(off[~turned])), ROUNDING)
    return float(np.clip(ratio, *TURN_RATIOS))

"""The noise of orientations beside that of points, by what a fit leaves of them."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64, Mask
from armd.compensation.diagnose.problem.linear import Linear
from armd.compensation.diagnose.problem.whitening import RestNoise
from armd.compensation.estimate.linear.blocks import Blocks

#: A ratio that changes by less (in its logarithm) has settled.
SETTLED = 0.05
#: No orientation is so much better, or worse, than a point.
LEAST, MOST = 1e-4, 1e4


def first_turn_ratio(residual: F64, turned: Mask) -> float:
    """How much farther off orientations are than points, by the middle ones of a residual (N,)."""
    if not turned.any():
        return 1.0
    off = np.linalg.norm(residual[: 3 * len(turned)].reshape(-1, 3), axis=1)
    ratio = float(np.median(off[turned])) / max(float(np.median(off[~turned])), 1e-9)
    return float(np.clip(ratio, LEAST, MOST))


def fitted_share(columns: Blocks, covariance: F64, noise: RestNoise) -> float:
    """Of the orientations' squares, how many a fit by *columns* takes, by the covariance (b, b) of
    its solution."""
    turned, total = noise.turned, 0.0
    if turned is None:
        return total
    for piece in columns.pieces:
        own = turned[piece.rests]
        white = noise.whitener[piece.rests[own]] @ piece.values[own]
        known = covariance[np.ix_(piece.columns, piece.columns)]
        total += float(((white @ known) * white).sum())
    return total


def turn_ratio(noise: RestNoise, linear: Linear, left: F64, fitted: float) -> float:
    """The ratio by what is *left* (N,), *fitted* of the squares being taken by the fit.

    What exceeds the part of the encoders is the orientations' own.
    """
    turned = noise.turned
    if turned is None:
        return noise.turn_ratio
    white = noise.whitener[turned] @ left[: 3 * len(turned)].reshape(-1, 3, 1)[turned]
    freedom = max(3.0 * float(noise.counts[turned].sum()) - fitted, 1.0)
    larger = float((white**2).sum()) / freedom
    encoders = noise.encoder_rad / noise.scale_mm
    of_encoders = encoders**2 * float((linear.joints[turned] ** 2).sum(axis=(1, 2)).mean()) / 3.0
    own = larger * (noise.turn_ratio**2 + of_encoders) - of_encoders
    return float(np.clip(np.sqrt(max(own, 0.0)), LEAST, MOST))

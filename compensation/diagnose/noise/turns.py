"""The noise of orientations relative to that of points, from the residuals of a fit."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import AXES, TURN_RATIOS
from armd.compensation.diagnose.problem.linear import Linear
from armd.compensation.diagnose.problem.whitening import RestNoise
from armd.compensation.estimate.linear.blocks import Blocks


def compute_fitted_freedom(columns: Blocks, covariance: F64, noise: RestNoise) -> float:
    """Return the degrees of freedom of the orientations that a fit by *columns* takes.

    *covariance* (b, b): of the fit's solution.
    """
    turned, total = noise.turned, 0.0
    if turned is None:
        return total
    for piece in columns.pieces:
        is_turned = turned[piece.rests]
        white = noise.whitener[piece.rests[is_turned]] @ piece.values[is_turned]
        block = covariance[np.ix_(piece.columns, piece.columns)]
        total += float(((white @ block) * white).sum())
    return total


def estimate_turn_ratio(noise: RestNoise, linear: Linear, residual: F64, fitted: float) -> float:
    """Estimate the noise ratio of orientations to points from the *residual* (N,).

    *fitted*: degrees of freedom taken by the fit. The orientations' own noise is what exceeds the
    encoders' part.
    """
    turned = noise.turned
    if turned is None:
        return noise.turn_ratio
    white = noise.whitener[turned] @ residual[: 3 * len(turned)].reshape(-1, 3, 1)[turned]
    freedom = max(AXES * float(noise.counts[turned].sum()) - fitted, 1.0)
    larger = float((white**2).sum()) / freedom
    encoders = noise.encoder_rad / noise.scale_mm
    of_encoders = encoders**2 * float((linear.joints[turned] ** 2).sum(axis=(1, 2)).mean()) / AXES
    squared_ratio = larger * (noise.turn_ratio**2 + of_encoders) - of_encoders
    return float(np.clip(np.sqrt(max(squared_ratio, 0.0)), *TURN_RATIOS))

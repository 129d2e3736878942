"""The noise of one reading, estimated from the residuals.

Model: covariance of a reading = σ_q² J_q J_qᵀ + σ_r² I, with J_q the tip's motion per encoder
angle. The encoders' share grows with reach, so readings far out count for less.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import minimize_scalar

from armd.arrays import F64, I64, Mask
from armd.compensation.estimate.adjustment import compute_backwards_map
from armd.compensation.estimate.noise.robust import LEAST_MM, find_far_off
from armd.compensation.model.row_algebra import compute_stretched_covariance, compute_whitening


@dataclass(frozen=True)
class ReadingNoise:
    """Standard deviations of one reading: of each encoder, and of the tip per axis."""

    encoder_rad: float
    reading_mm: float
    turn_mm: float = 0.0  # of an orientation, times its lever

    def covariance(self, joint_columns: F64, turned: Mask | None = None) -> F64:
        """Return the covariance (n, 3, 3) mm² of readings, from d tip / d angle (n, 3, N) mm/rad.

        *turned* (n,): those that are orientations.
        """
        shape = joint_columns @ joint_columns.transpose(0, 2, 1)
        own_mm = self.own_mm(len(shape), turned)[:, None, None]
        covariance: F64 = self.encoder_rad**2 * shape + own_mm**2 * np.eye(3)
        return covariance

    def own_mm(self, n: int, turned: Mask | None) -> F64:
        """Return the standard deviations (n,) per axis of readings apart from the encoders'."""
        if turned is None or not turned.any():
            return np.full(n, self.reading_mm)
        return np.where(turned, self.turn_mm, self.reading_mm)

    def compute_typical_mm(self, joint_columns: F64, freedom: I64 | int = 3) -> float:
        """Return the RMS standard deviation per axis of all readings; *freedom* (n,): axes."""
        return float(np.sqrt(np.mean(self._compute_squares(joint_columns, freedom) / freedom)))

    def distance_mm(self, joint_columns: F64, freedom: I64 | int = 3) -> float:
        """Return the RMS distance from the target of all readings; *freedom* (n,): axes."""
        return float(np.sqrt(np.mean(self._compute_squares(joint_columns, freedom))))

    def _compute_squares(self, joint_columns: F64, freedom: I64 | int) -> F64:
        of_encoders = self.encoder_rad**2 * np.einsum("nij,nij->n", joint_columns, joint_columns)
        squares: F64 = of_encoders + freedom * self.reading_mm**2
        return squares


@dataclass(frozen=True)
class Weighting:
    """The weights of one round: noise of the angles, fixed while the constants move.

    A reading's noise in mm scales with the levers, the repeatability of a point as well. In the
    fit, the angles are adjusted to the point where the ball was. So an arm of another size weights
    its scatter alike.
    """

    noise: ReadingNoise
    joints: F64  # (n, 3, N) mm/rad where the noise was estimated
    weight: F64  # (n,) robust weights
    turned: Mask | None = None  # (n,) orientations

    def compute_whitening(self, joints: F64) -> F64:
        """Return W (n, 3, 3) at levers d tip / d angle (n, 3, N)."""
        own_mm = self.noise.own_mm(len(joints), self.turned)
        covariance = compute_stretched_covariance(
            joints, self.joints, self._backwards, self.noise.encoder_rad**2, own_mm**2
        )
        return make_whitening(covariance, self.weight)

    @cached_property
    def _backwards(self) -> F64:
        return compute_backwards_map(self.joints)


def make_whitening(covariance: F64, weight: F64) -> F64:
    """Return W (n, 3, 3) with WᵀW = weight (n,) · covariance⁻¹ (n, 3, 3)."""
    return compute_whitening(covariance, weight)


def estimate_noise(
    residual_mm: F64,
    joint_columns: F64,
    whiten: F64,
    residual_share: F64,
    region: Mask,
    counts: F64 | None = None,
    freedom: I64 | None = None,
) -> ReadingNoise:
    """Estimate the noise by maximum likelihood from residuals (n, 3), without outliers.

    Outliers in a *region* (n,) are used. *whiten* (n, 3, 3) is the whitening of the fit,
    *residual_share* (n, 3, 3) the share that the fit left of each whitened reading. The likelihood
    is restricted: a component counts as the share of it that is left. Where noise and weights
    agree, after some rounds, this is the gradient of the restricted likelihood
    (docs/decisions/0025). *counts* (n,): the weight of each reading, copies of a posture together
    as one or more. *freedom* (n,): 1 for a reading on a surface, whose columns lie along its
    normal, else 3.
    """
    counts = np.ones(len(residual_mm)) if counts is None else counts
    shape = joint_columns @ joint_columns.transpose(0, 2, 1)
    value, vector = np.linalg.eigh(shape)
    value = np.maximum(value, 0.0)
    turned2 = np.einsum("nij,ni->nj", vector, residual_mm) ** 2
    typical = float(value.mean()) or 1.0
    axes = whiten @ vector
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    share_left = np.clip(np.einsum("nij,nik,nkj->nj", axes, residual_share, axes), 0.0, 1.0)
    share_left = np.maximum(share_left - (1.0 - counts)[:, None], 0.0)  # counts − fitted share
    if freedom is not None:  # levers lie along the normal, the last eigenvector
        share_left[freedom == 1, :2] = 0.0
    counted2 = turned2 * counts[:, None]
    inliers = ~find_far_off(turned2.sum(axis=1), LEAST_MM**2, freedom) | region
    inlier_value, inlier_share = value[inliers], share_left[inliers]
    inlier_counted2 = counted2[inliers]
    inlier_freedom = max(float(inlier_share.sum()), 1.0)

    def scaled(log_ratio: float, value: F64) -> F64:
        """Return variances (n, 3) up to one factor; encoders' share = ratio / (1 + ratio)."""
        share = 1.0 / (1.0 + np.exp(-log_ratio))
        result: F64 = share * value / typical + (1.0 - share)
        return result

    def negative_log_likelihood(log_ratio: float) -> float:
        variance = scaled(log_ratio, inlier_value)
        logs = float(np.sum(inlier_share * np.log(variance)))
        size = float(np.sum(inlier_counted2 / variance)) / inlier_freedom
        return logs / inlier_freedom + float(np.log(max(size, LEAST_MM**2)))

    log_ratio = float(
        minimize_scalar(negative_log_likelihood, bounds=(-12.0, 12.0), method="bounded").x
    )
    variance = scaled(log_ratio, value)
    inliers = ~find_far_off((turned2 / variance).sum(axis=1), LEAST_MM**2, freedom) | region
    freedom_left = max(float(share_left[inliers].sum()), 1.0)
    size = float(np.sum(counted2[inliers] / variance[inliers])) / freedom_left
    share = 1.0 / (1.0 + np.exp(-log_ratio))
    return ReadingNoise(
        encoder_rad=float(np.sqrt(size * share / typical)),
        reading_mm=max(float(np.sqrt(size * (1.0 - share))), LEAST_MM),
    )


def estimate_turn_noise(
    noise: ReadingNoise, residual_mm: F64, joint_columns: F64, residual_share: F64, counts: F64
) -> ReadingNoise:
    """Return *noise* with the noise of orientations, from residuals (n, 3) without outliers.

    *residual_share* (n, 3, 3) is as in `estimate_noise`. The orientations' own variance is the
    excess of their mean square over the encoders' part.
    """
    distance2 = np.sum(residual_mm**2, axis=1)
    inliers = ~find_far_off(distance2, LEAST_MM**2)
    share = np.trace(residual_share, axis1=1, axis2=2) - 3.0 * (1.0 - counts)
    freedom = max(float(np.maximum(share, 0.0)[inliers].sum()), 1.0)
    mean_square = float((counts * distance2)[inliers].sum()) / freedom
    of_encoders = np.einsum("nij,nij->n", joint_columns, joint_columns)[inliers].mean() / 3.0
    turn_variance = max(mean_square - noise.encoder_rad**2 * float(of_encoders), LEAST_MM**2)
    return replace(noise, turn_mm=float(np.sqrt(turn_variance)))

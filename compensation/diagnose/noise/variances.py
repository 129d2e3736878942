"""The noise of a set of rests: variances by restricted maximum likelihood, and whitening.

V = s² (ρ J_q J_qᵀ L⁻² + (1 − ρ) I) + Z diag(a) Zᵀ. The first part is independent between rests: the
encoders' noise through the joint Jacobian (L a lever that makes ρ a share) and the repeat of a
point. Z holds the errors that rests share: those of certified positions, a slow drift of the base,
and errors of constants within the covariance of their calibration.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from armd.arrays import F64
from armd.compensation.diagnose.constants import (
    AXES,
    FAR_LIKELIER,
    FIRST_SHARE_STEPS,
    GROSS,
    LEAST_DRIFT,
    LEAST_ENCODER_SHARE,
    LEAST_MM,
    LEVER_MM,
    MOST_DRIFT,
    MOST_ENCODER_SHARE,
    MOST_EVALUATIONS,
    MOST_ROBUST,
    MOST_SCALES,
    NEAR_SCALE_STEPS,
    NEAR_SHARE,
    NEXT_SHARE_STEPS,
    NOISE_DRIFTS,
    NOISE_SCALES,
    NOISE_SETTLED,
    SAME_SCALE,
    SCALE_SETTLED,
    SCALE_STEPS,
    SHARE_SETTLED,
    USUAL_DRIFT,
)
from armd.compensation.diagnose.noise.likelihood import Absorbing, Restricted
from armd.compensation.diagnose.problem.linear import Linear
from armd.compensation.diagnose.problem.whitening import RestNoise, compute_turn_ratio
from armd.compensation.estimate.linear.blocks import Blocks
from armd.compensation.estimate.noise.postures import compute_counts, estimate_shared_part
from armd.compensation.estimate.noise.reading import ReadingNoise, make_whitening
from armd.compensation.estimate.noise.robust import (
    MEDIAN_CHI2,
    WINSOR_AT,
    compute_huber_weights,
    find_monstrous,
)

MIDDLE_TO_MEAN = AXES / MEDIAN_CHI2


def _covariance(linear: Linear, share: float, turn_ratio: float = 1.0) -> F64:
    """Return the covariance (n, 3, 3) of each rest for s = 1."""
    unit = ReadingNoise(np.sqrt(share) / LEVER_MM, np.sqrt(1.0 - share), turn_ratio)
    return unit.covariance(linear.joints, linear.rests.observations.turned)


def estimate(
    linear: Linear, residual: F64, nuisance: Blocks, variance: F64, before: RestNoise | None = None
) -> RestNoise:
    """Estimate variances by REML from *residual* (N,), given nuisance columns and their *variance*.

    A winsorised residual prevents heavy tails from widening the noise of all the others. An
    estimate from *before* shortens the search. The uncertainties of certified lengths are in mm,
    not in units of a rest's noise. With such lengths, the search is repeated until both units
    agree.
    """
    lengths = linear.rests.observations.distances.standard_uncertainty_mm
    distance = np.maximum(lengths, LEAST_MM)
    if not len(distance):
        return _estimate(linear, residual, nuisance, variance, distance, 1.0, before)
    rests = residual[: 3 * linear.rests.n]
    scale = before.scale_mm if before else max(float(np.sqrt((rests**2).mean())), LEAST_MM)
    for _ in range(MOST_SCALES):
        noise = _estimate(linear, residual, nuisance, variance, distance, scale, before)
        if abs(np.log(noise.scale_mm / scale)) < SAME_SCALE:
            break
        scale = noise.scale_mm
    return noise


def _estimate(
    linear: Linear,
    residual: F64,
    nuisance: Blocks,
    variance: F64,
    distance: F64,
    scale_mm: float,
    before: RestNoise | None,
) -> RestNoise:
    """Estimate the noise with lengths' uncertainties as if s were *scale_mm*.

    *distance* (D,) mm: the lengths' standard uncertainties.
    """
    relative = distance / scale_mm
    absorbing = Absorbing.from_meeting(nuisance.meeting, variance)
    turned = linear.rests.observations.turned
    turn_ratio = before.turn_ratio if before else compute_turn_ratio(residual, turned)
    # Copies count as one, as if they shared all their error, until their scatter is known.
    shared = before.shared_part if before else 1.0
    counts = compute_counts(linear.rests.posture, shared)
    # Across a surface there is no equation, so that part of the whitening must not count.
    counted, across = np.sqrt(counts), 0.0
    if linear.normal is not None:
        across = 2.0 * float(counts[linear.normal.any(axis=1)].sum())
    rows = AXES * float(counts.sum()) - across + len(distance)

    nearest = None if before is None else (before.scale_mm, before.drift_mm)

    @cache
    def evaluate_share(share: float) -> tuple[float, float, float, bool]:
        nonlocal nearest
        whitener = _unit_whitener(linear, share, turn_ratio)
        products = nuisance.products(counted[:, None, None] * whitener, relative, residual)
        cost, scale, drift, settled = _best_scale(
            Restricted.from_products(products, absorbing, rows), nearest
        )
        nearest = scale, drift
        log_det = -2.0 * float(counts @ np.log(np.einsum("nii->ni", whitener)).sum(axis=1))
        if across:
            log_det -= across * float(np.log1p(-share))
        return cost + log_det, scale, drift, settled

    low, high, steps = LEAST_ENCODER_SHARE, MOST_ENCODER_SHARE, FIRST_SHARE_STEPS
    if before is not None:
        low = max(low, before.encoder_share - NEAR_SHARE)
        high = min(high, before.encoder_share + NEAR_SHARE)
        steps = NEXT_SHARE_STEPS
    minimum = minimize_scalar(
        lambda share: evaluate_share(float(share))[0],
        bounds=(low, high),
        method="bounded",
        options={"maxiter": steps, "xatol": SHARE_SETTLED},
    )
    share = float(minimum.x)
    _, scale, drift, settled = evaluate_share(share)
    return RestNoise(
        scale_mm=scale,
        encoder_share=share,
        drift_mm=drift,
        encoder_rad=scale * np.sqrt(share) / LEVER_MM,
        repeat_mm=scale * np.sqrt(1.0 - share),
        whitener=counted[:, None, None] * _unit_whitener(linear, share, turn_ratio) / scale,
        distance_mm=distance,
        counts=counts,
        shared_part=shared,
        settled=settled,
        normal=linear.normal,
        turned=turned if turned.any() else None,
        turn_ratio=turn_ratio,
    )


def add_shared_part(noise: RestNoise, linear: Linear, residual: F64) -> RestNoise:
    """Return the noise with the part that copies of a posture share, from their *residual* (N,)."""
    posture, n = linear.rests.posture, linear.rests.n
    white = noise.whiten_rests(residual[: 3 * n].reshape(n, 3))
    part = estimate_shared_part(white, posture, AXES if noise.normal is None else noise.freedom)
    return noise.with_shared_part(part, posture)


def _unit_whitener(linear: Linear, share: float, turn_ratio: float = 1.0) -> F64:
    """Return the whitening (n, 3, 3) for s = 1."""
    return make_whitening(_covariance(linear, share, turn_ratio), np.ones(linear.rests.n))


def _best_scale(
    restricted: Restricted, nearest: tuple[float, float] | None = None
) -> tuple[float, float, float, bool]:
    """Return (−2 log likelihood, s, drift, settled) at the best scale and drift for a share.

    *nearest*: s and drift in mm of a similar share, from which the search is shorter.
    """
    drifts = len(restricted.curvature) > 0

    def values(logs: F64) -> tuple[float, float]:
        scale = max(float(np.exp(logs[0])), LEAST_MM)
        return scale, scale * min(float(np.exp(logs[1])), MOST_DRIFT) if drifts else 0.0

    def cost(logs: F64) -> float:
        return restricted.negative_log_likelihood(*values(logs))

    begin, steps = _begin(restricted, nearest, cost)
    corners = begin + np.vstack([np.zeros(len(begin)), np.diag(steps[: len(begin)])])
    minimum = minimize(
        cost,
        begin,
        method="Nelder-Mead",
        options={
            "xatol": SCALE_SETTLED,
            "fatol": SCALE_SETTLED,
            "maxfev": MOST_EVALUATIONS,
            "initial_simplex": corners,
        },
    )
    return float(minimum.fun), *values(minimum.x), bool(minimum.success)


def _begin(
    restricted: Restricted, nearest: tuple[float, float] | None, cost: Callable[[F64], float]
) -> tuple[F64, tuple[float, float]]:
    """Return the logs of scale and relative drift where a search begins, and its first steps."""
    count = 1 + (len(restricted.curvature) > 0)
    mean_square = max(restricted.squared_norm, 0.0) / max(restricted.freedom, 1)
    first = max(float(np.sqrt(mean_square)), LEAST_MM)
    begin = np.log([first, USUAL_DRIFT])[:count]
    least_cost = cost(begin)
    if count > 1:  # where drift is nearly all of the residual, the noise is far smaller
        scales = [first * scale for scale in NOISE_SCALES] + ([nearest[0]] if nearest else [])
        starts = [np.log([scale, drift]) for scale in scales for drift in NOISE_DRIFTS]
        costs = [cost(start) for start in starts]
        if min(costs) < least_cost - FAR_LIKELIER:
            begin = starts[int(np.argmin(costs))]
        least_cost = min(least_cost, *costs)
    if nearest is not None:  # unless it is near another minimum than the best start
        scale, drift = nearest
        start = np.log([scale, max(drift / scale, LEAST_DRIFT)])[:count]
        if cost(start) < least_cost:
            return start, NEAR_SCALE_STEPS
    return begin, SCALE_STEPS


def clip_gross(residual: F64, noise: RestNoise, fit: Callable[[F64, RestNoise], F64]) -> F64:
    """Return the residual (N,) clipped about *fit* of it, as `clip_residual` does.

    One reading 100 times off pulls a fit so far that all others have large residuals, and the noise
    estimate makes it look ordinary. Where a few rests have most of the sum of squares, they are
    clipped by a scale from the median rest. The fit is then repeated until it settles.
    """
    nothing = np.zeros_like(residual)
    monsters = find_monstrous(residual[: 3 * len(noise.whitener)].reshape(-1, 3)).any()
    # Then the residual itself is used: monsters hardly moved its poses, but would move a fit.
    fitted = nothing if monsters else fit(residual, noise)
    squares = noise.squares(_deviations_mm(residual, fitted, noise))
    usual = MIDDLE_TO_MEAN * float(np.median(squares)) if len(squares) else 1.0
    if float(squares.mean()) <= GROSS * usual:
        return clip_residual(residual, fitted, noise)
    for _ in range(MOST_ROBUST):
        before = usual
        clipped = clip_residual(residual, fitted, noise, WINSOR_AT * float(np.sqrt(usual / AXES)))
        fitted = fit(clipped, noise)
        usual = MIDDLE_TO_MEAN * float(
            np.median(noise.squares(_deviations_mm(residual, fitted, noise)))
        )
        if usual > NOISE_SETTLED * before:
            break
    return clip_residual(residual, fitted, noise, WINSOR_AT * float(np.sqrt(usual / AXES)))


def _deviations_mm(residual: F64, fitted: F64, noise: RestNoise) -> F64:
    """Return the deviations (n, 3) mm of each rest from *fitted* (N,)."""
    n = len(noise.whitener)
    deviations_mm: F64 = (residual - fitted)[: 3 * n].reshape(n, 3)
    return deviations_mm


def clip_residual(residual: F64, fitted: F64, noise: RestNoise, limit: float = WINSOR_AT) -> F64:
    """Return the residual (N,), each rest clipped to *limit* standard deviations from *fitted*."""
    n = len(noise.whitener)
    deviations_mm = _deviations_mm(residual, fitted, noise)
    size = np.sqrt((noise.whiten_rests(deviations_mm) ** 2).sum(axis=1)) * noise.stretch
    clipped = residual.copy()
    clipped[: 3 * n] = (
        fitted[: 3 * n] + (deviations_mm * compute_huber_weights(size, limit)[:, None]).ravel()
    )
    return clipped

"""The treatment of readings far off, in one place: two weights and one test.

*Weight in a fit.* `compute_redescending_weights` is used where the fit begins far from the truth
(`armd calibrate`). Beyond one in 10 000 the pull of a reading falls off as 1/d, so that a wrong
reading loses its influence. `compute_huber_weights` is used where the fit is near (`armd
diagnose`). The pull stays as at the edge, so that a cause which few rests show is not taken for
wrong readings. *Outlier or not.* `select_outliers` decides for both, by whether the noise's own
tails explain a reading.

All use the distance of a reading's three components together, in units of its noise: a χ² of three
degrees of freedom where the noise is normal. A reading on a surface has one component; its distance
is stretched to that of three components of the same probability.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq
from scipy.special import fdtrc, fdtri, gammaincc, gammainccinv, gammaincinv

from armd.arrays import F64, I64, Mask

# Quantiles of χ² with three degrees of freedom: one in 10 000 above, and one in two.
DOWNWEIGHT_CHI2 = 2.0 * float(gammaincinv(1.5, 1 - 1e-4))
MEDIAN_CHI2 = 2.0 * float(gammaincinv(1.5, 0.5))
#: These quantiles for one component: a reading on a surface.
DOWNWEIGHT_CHI2_1D = 2.0 * float(gammaincinv(0.5, 1 - 1e-4))
MEDIAN_CHI2_1D = 2.0 * float(gammaincinv(0.5, 0.5))
#: Beyond this squared distance of one component the probability underflows.
LARGEST_CHI2 = 500.0
#: A residual beyond this many standard deviations of a rest's three components is clipped to it:
#: one in eighty is, where the noise is normal.
WINSOR_AT = 3.3
#: One reading so many times farther off than the median moves its whole placement by several times
#: the noise. Clipping corrects a few times the noise in each round: 100 times is corrected, 10 000
#: times is not. A target mistaken for its neighbour is 10 000 to 100 000 times off.
MONSTROUS = 300.0
#: The ratio to the median where that reading moved the median, too: one of thirty, in one pose.
SUSPECT = 10.0
#: No reading counts as better than this (mm): a count of 23 bits at one metre is seven times as
#: much. Readings without any noise would make everything look known; see docs/decisions/0023.
LEAST_MM = 1e-4

FALSE_OUTLIER_P = 1e-3  # chance of one false outlier in a whole data set
HEAVIEST, LIGHTEST = 2.0, 30.0  # degrees of freedom of the tails
MIDDLE, EDGE = 0.50, 0.97  # quantiles from which the tails are estimated
#: From so many degrees of freedom on, the bulk is normal. Below, a sum of several heavy-tailed
#: errors has heavier tails than its bulk shows, by about this factor in the degrees of freedom.
NORMAL, FAR_OUT = 15.0, 0.4
MOST_SHARE = 0.05  # more rests than this are not single readings
#: The sizes of power-law tails fall off no faster than with this exponent.
TAIL_INDEX = 3.0


def compute_mahalanobis2(residual_mm: F64, covariance: F64) -> F64:
    """Return the squared Mahalanobis distances (n,) of residuals (n, 3)."""
    solved = np.linalg.solve(covariance, residual_mm[:, :, None])[:, :, 0]
    distance: F64 = np.einsum("ni,ni->n", residual_mm, solved)
    return distance


def to_three_components(distance2: F64, freedom: I64) -> F64:
    """Return squared distances (n,) of three components that are as improbable as *distance2* (n,).

    *freedom* (n,): its numbers of components, 1 or 3.
    """
    if not (freedom == 1).any():
        return distance2
    limited2 = np.minimum(distance2, LARGEST_CHI2)
    stretched = 2.0 * gammainccinv(1.5, gammaincc(0.5, limited2 / 2.0)) + (distance2 - limited2)
    alike: F64 = np.where(freedom == 1, stretched, distance2)
    return alike


def compute_redescending_weights(distance2: F64, region: Mask) -> F64:
    """Return weights (n,) of squares from squared distances; a *region* always has full weight."""
    weight = np.minimum(1.0, DOWNWEIGHT_CHI2 / np.maximum(distance2, 1e-300))
    return np.where(region, 1.0, weight)


def find_monstrous(residual_mm: F64, times: float = MONSTROUS) -> Mask:
    """Find which (n,) of residuals (n, 3) mm are over so many *times* the median one."""
    off_mm = np.linalg.norm(residual_mm, axis=1)
    usual_mm = max(float(np.median(off_mm)), LEAST_MM) if len(off_mm) else np.inf
    is_monstrous: Mask = off_mm > times * usual_mm
    return is_monstrous


def compute_huber_weights(size: F64, edge: float = WINSOR_AT) -> F64:
    """Return weights (n,) from distances *size* (n,), which shorten residuals to the edge."""
    weights: F64 = edge / np.maximum(size, max(edge, 1e-12))
    return weights


def compute_huber_loss(size: F64, stretch: F64 | float = 1.0) -> float:
    """Return Huber's loss of distances (n,): half the square, and linear beyond the edge.

    Distances that a *stretch* (n,) has brought to one edge count as they would at their own.
    """
    within = np.minimum(size, WINSOR_AT)
    return float((within * (size - 0.5 * within) / stretch**2).sum())


def compute_edge_stretch(freedom: I64) -> F64:
    """Return the factors (n,) that bring distances of 1 or 3 components to one edge.

    *freedom* (n,): their components. A distance as improbable as `WINSOR_AT` of three components
    becomes `WINSOR_AT`.
    """
    edge2 = 2.0 * float(gammainccinv(0.5, float(gammaincc(1.5, WINSOR_AT**2 / 2.0))))
    return np.where(freedom == 1, WINSOR_AT / np.sqrt(edge2), 1.0)


def find_far_off(distance2: F64, least2: float, freedom: I64 | None = None) -> Mask:
    """Find squared distances (n,) beyond that of one normal reading in 10 000.

    The median determines the scale. A distance must also be beyond *least2*. *freedom* (n,): the
    components, 1 or 3; None: 3 each.
    """
    threshold2 = (
        DOWNWEIGHT_CHI2
        if freedom is None
        else np.where(freedom == 1, DOWNWEIGHT_CHI2_1D, DOWNWEIGHT_CHI2)
    )
    is_far: Mask = distance2 > np.maximum(
        threshold2 * compute_usual_square(distance2, freedom), least2
    )
    return is_far


def compute_usual_square(distance2: F64, freedom: I64 | None = None) -> float:
    """Return the variance of one component by the median of squared distances (n,).

    *freedom* (n,): their components, 1 or 3; None: 3 each.
    """
    if freedom is None:
        return float(np.median(distance2)) / MEDIAN_CHI2
    return float(np.median(distance2 / np.where(freedom == 1, MEDIAN_CHI2_1D, MEDIAN_CHI2)))


def select_outliers(distance2: F64, region: Mask) -> tuple[I64, float]:
    """Select the squared distances (n,) that no tail explains, with the smallest p.

    The p is family-wise. There are two tests: each distance against the tail of the others, and a
    gap in the ordered sizes that no tail leaves (several outliers of one kind hide from the first
    test). Readings in a *region* (n,) are not tested.
    """
    candidate_rows = np.flatnonzero(~region)
    candidate_distance2 = distance2[candidate_rows]
    nothing = np.zeros(0, dtype=np.int64), 1.0
    if not len(candidate_distance2) or not find_far_off(candidate_distance2, DOWNWEIGHT_CHI2).any():
        return nothing
    single, p_single = _find_beyond_tail(candidate_distance2)
    group, p_group = _find_beyond_gap(np.sqrt(candidate_distance2))
    outliers = np.union1d(single, group)
    if not len(outliers) or len(outliers) > MOST_SHARE * len(candidate_distance2):
        return nothing
    return candidate_rows[outliers], min(p_single, p_group)


def _find_beyond_tail(candidate_distance2: F64) -> tuple[I64, float]:
    """Find outliers beyond a Student tail fitted to the bulk, and the smallest p.

    The squared norm of three components with Student tails is 3 s² F(3, ν); s and ν come from the
    bulk, so that outliers do not influence them.
    """
    middle, edge = np.quantile(candidate_distance2, [MIDDLE, EDGE])
    tails = _solve_freedom(float(edge / middle))
    tails = LIGHTEST if tails > NORMAL else max(HEAVIEST, FAR_OUT * tails)
    scale = middle / fdtri(3, tails, MIDDLE)
    p = np.minimum(1.0, len(candidate_distance2) * fdtrc(3, tails, candidate_distance2 / scale))
    return np.flatnonzero(p < FALSE_OUTLIER_P), float(p.min(initial=1.0))


def _find_beyond_gap(size: F64) -> tuple[I64, float]:
    """Find outliers beyond a gap in the ordered sizes, and its p.

    In a power-law tail of index a, k·a·log(x_k / x_k+1) of the ordered sizes is exponential
    (Rényi). A gap far too wide for that separates another population from the tail.
    """
    order = np.argsort(-size)
    most_outliers = int(MOST_SHARE * len(size))
    if most_outliers < 1:
        return np.zeros(0, dtype=np.int64), 1.0
    ranked = size[order[: most_outliers + 1]]
    ranks = np.arange(1, most_outliers + 1)
    log_p = -TAIL_INDEX * ranks * np.log(ranked[:-1] / ranked[1:]) + np.log(most_outliers)
    widest = int(np.argmin(log_p))
    p = min(1.0, float(np.exp(log_p[widest])))
    return (order[: widest + 1] if p < FALSE_OUTLIER_P else order[:0]), p


def _solve_freedom(ratio: float) -> float:
    """Return the degrees of freedom ν at which the two quantiles of F(3, ν) have this *ratio*."""

    def excess(log_tails: float) -> float:
        tails = np.exp(log_tails)
        edge = fdtri(3, tails, EDGE)
        return float(edge / fdtri(3, tails, MIDDLE) - ratio)

    low, high = np.log(HEAVIEST), np.log(LIGHTEST)
    if excess(low) <= 0:
        return HEAVIEST
    if excess(high) >= 0:
        return LIGHTEST
    return float(np.exp(brentq(excess, low, high)))

"""Single rests that belong to no effect, judged against tails as heavy as the noise has."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.stats import f as f_distribution

from armd.compensation.diagnose.fit import Fit

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

ALPHA = 1e-3  # chance of one false outlier in a whole data set
HEAVIEST, LIGHTEST = 2.5, 60.0  # degrees of freedom of the tails
MIDDLE, EDGE = 0.50, 0.97  # quantiles that tell how heavy they are
MOST_SHARE = 0.05  # more rows than this are not single readings


def find_outliers(current: Fit) -> tuple[I64, float]:
    """Rests whose residual no tail explains, and the smallest family-wise p.

    The squared distance of three components with Student tails is 3 s² F(3, ν); s and ν come
    from the bulk of the rests, so that the outliers do not speak for themselves.
    """
    n = current.linear.rests.n
    left = (current.raw_residual - current.fitted)[: 3 * n].reshape(n, 3)
    white = np.einsum("nij,nj->ni", current.noise.whitener, left)
    square = (white**2).sum(axis=1)
    middle, edge = np.quantile(square, [MIDDLE, EDGE])
    tails = _freedom(float(edge / middle))
    scale = middle / f_distribution.ppf(MIDDLE, 3, tails)
    p = np.minimum(1.0, n * f_distribution.sf(square / scale, 3, tails))
    rests = np.flatnonzero(p < ALPHA)
    if len(rests) > MOST_SHARE * n:
        return np.zeros(0, dtype=np.int64), 1.0
    return rests, float(p.min(initial=1.0))


def _freedom(ratio: float) -> float:
    """Degrees of freedom ν at which the two quantiles of F(3, ν) stand in this *ratio*."""

    def excess(log_tails: float) -> float:
        tails = np.exp(log_tails)
        return float(
            f_distribution.ppf(EDGE, 3, tails) / f_distribution.ppf(MIDDLE, 3, tails) - ratio
        )

    low, high = np.log(HEAVIEST), np.log(LIGHTEST)
    if excess(low) <= 0:
        return HEAVIEST
    if excess(high) >= 0:
        return LIGHTEST
    return float(np.exp(brentq(excess, low, high)))

"""Single rests that belong to no effect, judged against tails as heavy as the noise has."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.optimize import brentq
from scipy.special import fdtrc, fdtri

from armd.compensation.diagnose.fitting.fit import Fit

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

ALPHA = 1e-3  # chance of one false outlier in a whole data set
HEAVIEST, LIGHTEST = 2.0, 30.0  # degrees of freedom of the tails
MIDDLE, EDGE = 0.50, 0.97  # quantiles that tell how heavy they are
#: From here on the bulk is normal. Below, a sum of several heavy-tailed errors is heavier far
#: out than its bulk says, by about this factor in the degrees of freedom.
NORMAL, FAR_OUT = 15.0, 0.4
MOST_SHARE = 0.05  # more rests than this are not single readings
#: The sizes of power-law tails fall off no faster than with this exponent.
TAIL_INDEX = 3.0


def find_outliers(current: Fit) -> tuple[I64, float]:
    """Rests whose residual no tail explains, and the smallest family-wise p.

    Two looks: each rest against the tail of the others, and a gap in the ordered sizes that no
    tail leaves (several outliers of one kind hide from the first).
    """
    n = current.linear.rests.n
    left = (current.raw_residual - current.fitted)[: 3 * n].reshape(n, 3)
    white = np.einsum("nij,nj->ni", current.noise.whitener, left)
    square = (white**2).sum(axis=1)
    single, p_single = _beyond_the_tail(square)
    group, p_group = _beyond_a_gap(np.sqrt(square))
    found = np.union1d(single, group)
    if not len(found) or len(found) > MOST_SHARE * n:
        return np.zeros(0, dtype=np.int64), 1.0
    return found, min(p_single, p_group)


def _beyond_the_tail(square: F64) -> tuple[I64, float]:
    """The squared norm of three components with Student tails is 3 s² F(3, ν); s and ν come from
    the bulk, so that the outliers do not speak for themselves."""
    middle, edge = np.quantile(square, [MIDDLE, EDGE])
    tails = _freedom(float(edge / middle))
    tails = LIGHTEST if tails > NORMAL else max(HEAVIEST, FAR_OUT * tails)
    scale = middle / fdtri(3, tails, MIDDLE)
    p = np.minimum(1.0, len(square) * fdtrc(3, tails, square / scale))
    return np.flatnonzero(p < ALPHA), float(p.min(initial=1.0))


def _beyond_a_gap(size: F64) -> tuple[I64, float]:
    """In a power-law tail of index a, k·a·log(x_k / x_k+1) of the ordered sizes is exponential
    (Rényi): a gap far too wide for that parts another population from the tail."""
    order = np.argsort(-size)
    most = int(MOST_SHARE * len(size))
    if most < 1:
        return np.zeros(0, dtype=np.int64), 1.0
    ranked = size[order[: most + 1]]
    ranks = np.arange(1, most + 1)
    log_p = -TAIL_INDEX * ranks * np.log(ranked[:-1] / ranked[1:]) + np.log(most)
    widest = int(np.argmin(log_p))
    p = min(1.0, float(np.exp(log_p[widest])))
    return (order[: widest + 1] if p < ALPHA else order[:0]), p


def _freedom(ratio: float) -> float:
    """Degrees of freedom ν at which the two quantiles of F(3, ν) stand in this *ratio*."""

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

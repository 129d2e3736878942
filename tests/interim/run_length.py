"""How long a history without a change goes on until a false alarm: the statistic, simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from armd.arrays import F64, I64
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.evidence.likelihood import MOST_BACK, NOISE_WORD, SIZES
from armd.compensation.interim.evidence.stack import DAY_S, RunningSums, stack

#: Standing errors of a size less likely than this are left out: without a change no ratio is so
#: large as to make up for it.
LEAST_LOG = -25.0


def noise_alone(
    month: Sequence[Reduced], causes: Sequence[Cause], checks: int, draws: int, seed: int
) -> F64:
    """(checks, draws) the log statistic of histories without a change: the poses of a *month*'s
    checks again and again, noise and what is wrong all along drawn anew for each of *draws*."""
    many = [
        replace(month[i % len(month)], mean_unix_s=month[0].mean_unix_s + DAY_S * i)
        for i in range(checks)
    ]
    of = stack(many, causes)
    rng = np.random.default_rng([seed, 0x1C])
    known = rng.normal(size=(of.known[0].shape[1], draws))
    known[slice(*of.standing)] *= rng.choice(of.scales, draws)
    noise = [k @ known + rng.normal(size=(len(k), draws)) for k in of.known]
    sums = RunningSums(of)
    towards = [c.T @ z for c, z in zip(of.columns, noise, strict=True)]
    days = of.time_d / 30.0
    plain = np.cumsum(np.stack(towards), axis=0)
    timed = np.cumsum(np.stack([d * t for d, t in zip(days, towards, strict=True)]), axis=0)
    zero = np.zeros_like(plain[:1])
    plain, timed = np.concatenate([zero, plain]), np.concatenate([zero, timed])
    known_side = np.cumsum(
        np.stack([k.T @ z for k, z in zip(of.known, noise, strict=True)]), axis=0
    )
    square = np.cumsum(np.stack([(z**2).sum(axis=0) for z in noise]), axis=0)
    priors = np.log(
        np.maximum([[c.prior_sudden, c.prior_gradual] for c in causes], 1e-300)
    ) - np.log(len(SIZES))
    statistics = np.full((checks, draws), -np.inf)
    for n in range(1, of.n + 1):
        first = np.arange(max(0, n - MOST_BACK), n)
        begun = [sums.begun(first, n, ramp=ramp) for ramp in (False, True)]
        freedom = NOISE_WORD + float(sums.numbers[n])
        inverses, sides, marginals = [], [], []
        for scale in of.scales:
            factor, _, _ = sums.without_change(n, scale)
            inverse = np.linalg.inv(factor) * of.scaled(scale)
            side = inverse @ known_side[n - 1]
            left = NOISE_WORD + square[n - 1] - (side**2).sum(axis=0)
            marginals.append(-np.log(np.diag(factor)).sum() - 0.5 * freedom * np.log(left))
            inverses.append(inverse)
            sides.append(side)
        share = np.array(marginals) - logsumexp(marginals, axis=0)
        ratios = np.full((len(of.scales), draws), -np.inf)
        for inverse, side, own_share, ratio in zip(inverses, sides, share, ratios, strict=True):
            some = own_share > LEAST_LOG
            ratio[some] = _log_ratio(sums, begun, inverse, side[:, some], priors, freedom,
                                     square[n - 1, some],
                                     (plain[n] - plain[first])[..., some],
                                     (timed[n] - timed[first])[..., some], first)  # fmt: skip
        statistics[n - 1] = logsumexp(share + ratios, axis=0)
    return statistics


def _log_ratio(
    sums: RunningSums,
    begun: Sequence[tuple[F64, F64, list[F64]]],
    inverse: F64,
    side: F64,
    priors: F64,
    freedom: float,
    square: F64,
    plain: F64,
    timed: F64,
    first: I64,
) -> F64:
    """(draws,) log of the summed ratio with standing errors of one size."""
    left = NOISE_WORD + square - (side**2).sum(axis=0)
    total = np.full(side.shape[1], -np.inf)
    for shape, (cross, _, owns) in enumerate(begun):
        cross = inverse @ cross
        own_side = plain if shape == 0 else timed - sums.origin(first)[:, None, None] * plain
        clear = own_side - np.einsum("tqc,qs->tcs", cross, side, optimize=True)
        for (members, at), own in zip(sums.groups, owns, strict=True):
            block = cross[:, :, at].transpose(0, 2, 3, 1)
            value, vector = np.linalg.eigh(own - block @ block.transpose(0, 1, 3, 2))
            value = np.maximum(value, 0.0)[..., None]
            along2 = (vector.swapaxes(-1, -2) @ clear[:, at]) ** 2
            for size in SIZES:
                curvature = 1.0 + size**2 * value
                quad = np.minimum((size**2 * along2 / curvature).sum(axis=2), 0.999 * left)
                ratio = -0.5 * np.log(curvature).sum(axis=2)
                ratio = ratio - 0.5 * freedom * np.log1p(-quad / left)
                ratio = ratio + priors[members, shape][None, :, None]
                total = np.logaddexp(total, logsumexp(ratio, axis=(0, 1)))
    return total


def alarms_and_watched(statistics: F64, limit: float) -> tuple[int, int]:
    """How many histories pass *limit*, and how many checks are watched until they do."""
    over = statistics >= limit
    first = np.where(over.any(axis=0), over.argmax(axis=0) + 1, len(over))
    return int(over.any(axis=0).sum()), int(first.sum())

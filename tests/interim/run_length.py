"""How long a history without a change goes on until a false alarm: the statistic, simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from armd.arrays import F64
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.evidence.likelihood import MOST_BACK, NOISE_WORD, SIZES
from armd.compensation.interim.evidence.stack import DAY_S, RunningSums, stack


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
        factor = np.linalg.cholesky(sums.known[n])
        inverse = np.linalg.inv(factor)
        side = inverse @ known_side[n - 1]
        left = NOISE_WORD + square[n - 1] - (side**2).sum(axis=0)
        freedom = NOISE_WORD + float(sums.numbers[n])
        total = np.full(draws, -np.inf)
        for shape in (0, 1):
            cross, _, owns = sums.begun(first, n, ramp=shape == 1)
            cross = inverse @ cross
            if shape == 0:
                own_side = plain[n] - plain[first]
            else:
                origin = sums.origin(first)[:, None, None]
                own_side = timed[n] - timed[first] - origin * (plain[n] - plain[first])
            clear = own_side - np.einsum("tqc,qs->tcs", cross, side)
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
        statistics[n - 1] = total
    return statistics


def alarms_and_watched(statistics: F64, limit: float) -> tuple[int, int]:
    """How many histories pass *limit*, and how many checks are watched until they do."""
    over = statistics >= limit
    first = np.where(over.any(axis=0), over.argmax(axis=0) + 1, len(over))
    return int(over.any(axis=0).sum()), int(first.sum())

"""How long a history without a change goes on until a false alarm: the statistic, simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from armd.arrays import F64
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.evidence.likelihood import MOST_BACK, NOISE_WEIGHT, SIZES
from armd.compensation.interim.evidence.stack import DAY_S, OnsetSums, RunningSums, join_checks

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
    of = join_checks(many, causes)
    rng = np.random.default_rng([seed, 0x1C])
    known = rng.normal(size=(of.error_columns[0].shape[1], draws))
    known[slice(*of.standing)] *= rng.choice(of.scales, draws)
    noise = [k @ known + rng.normal(size=(len(k), draws)) for k in of.error_columns]
    sums = RunningSums(of)
    towards = [c.T @ z for c, z in zip(of.columns, noise, strict=True)]
    days = of.time_d / 30.0
    plain = np.cumsum(np.stack(towards), axis=0)
    timed = np.cumsum(np.stack([d * t for d, t in zip(days, towards, strict=True)]), axis=0)
    zero = np.zeros_like(plain[:1])
    plain, timed = np.concatenate([zero, plain]), np.concatenate([zero, timed])
    known_side = np.cumsum(
        np.stack([k.T @ z for k, z in zip(of.error_columns, noise, strict=True)]), axis=0
    )
    square = np.cumsum(np.stack([(z**2).sum(axis=0) for z in noise]), axis=0)
    priors = np.log(
        np.maximum([[c.prior_sudden, c.prior_gradual] for c in causes], 1e-300)
    ) - np.log(len(SIZES))
    statistics = np.full((checks, draws), -np.inf)
    for n in range(1, of.n + 1):
        first = np.arange(max(0, n - MOST_BACK), n)
        known = of.eliminate_errors(sums.sum_first(n))
        begun = list(sums.sum_by_onset(first, n, known.rotation))
        freedom = NOISE_WEIGHT + float(sums.numbers[n])
        roots, sides, marginals = [], [], []
        for weight, spread in zip(known.weights, known.spread, strict=True):
            root = np.sqrt(weight)
            side = root[:, None] * (known.rotation @ known_side[n - 1])
            left = NOISE_WEIGHT + square[n - 1] - (side**2).sum(axis=0)
            marginals.append(-spread - 0.5 * freedom * np.log(left))
            roots.append(root)
            sides.append(side)
        share = np.array(marginals) - logsumexp(marginals, axis=0)
        ratios = np.full((len(of.scales), draws), -np.inf)
        for root, side, own_share, ratio in zip(roots, sides, share, ratios, strict=True):
            some = own_share > LEAST_LOG
            ratio[some] = _log_ratio(sums, begun, root, side[:, some], priors, freedom,
                                     square[n - 1, some],
                                     (plain[n] - plain[first])[..., some],
                                     (timed[n] - timed[first])[..., some],
                                     sums.compute_origins(first, n))  # fmt: skip
        statistics[n - 1] = logsumexp(share + ratios, axis=0)
    return statistics


def _log_ratio(
    sums: RunningSums,
    begun: Sequence[OnsetSums],
    root: F64,
    side: F64,
    priors: F64,
    freedom: float,
    square: F64,
    plain: F64,
    timed: F64,
    origin: F64,
) -> F64:
    """(draws,) log of the summed ratio with standing errors of one size."""
    left = NOISE_WEIGHT + square - (side**2).sum(axis=0)
    total = np.full(side.shape[1], -np.inf)
    for shape, one in enumerate(begun):
        cross = one.cross * root  # (T, C, q), columns group by group
        own_side = plain if shape == 0 else timed - origin[:, None, None] * plain
        own_side = own_side[:, np.concatenate([at.ravel() for _, at in sums.groups])]
        clear = own_side - cross @ side
        end = 0
        for (members, at), own in zip(sums.groups, one.cause_grams, strict=True):
            begin, end = end, end + at.size
            block = cross[:, begin:end].reshape(*own.shape[:3], -1)
            clear_of = clear[:, begin:end].reshape(*own.shape[:3], -1)
            value, vector = np.linalg.eigh(own - block @ block.swapaxes(-1, -2))
            value = np.maximum(value, 0.0)[..., None]
            along2 = (vector.swapaxes(-1, -2) @ clear_of) ** 2
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

"""How much likelier all readings are with a change than without: for every cause, onset and shape.

The alarm is Shiryaev's and Roberts's: R = Σ over onsets of the likelihood ratio, each of them mixed
over causes, shapes and sizes by their priors. Without a change R − (checks) is a martingale of mean
zero, so the mean number of checks until R first exceeds A is at least A, whatever the poses and the
artefacts were (Pollak, Ann. Statist. 13, 1985; Tartakovsky, Nikiforov, Basseville, Sequential
Analysis, 2014, ch. 7); it is about four times A, for where R passes A it passes it by far. What is
wrong all along, how large that is, and the scale of the noise have priors and are integrated out,
under both hypotheses alike, which keeps it so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaln, logsumexp

from armd.arrays import F64, I64
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.stack import CheckSums, RunningSums, Stack

#: About so many checks pass on average until a false alarm.
RUN_LENGTH = 500.0
#: The bound on that, the limit itself, is not tight: by simulation of the statistic a limit of 120
#: gives one false alarm in 500 checks (decision 34).
LIMIT = float(np.log(120.0))
#: Sizes a change may have, in typical ones; as likely as each other.
SIZES = (0.1, 0.3, 1.0, 3.0, 10.0)
#: The calibration's word on the noise weighs as much as so many numbers.
NOISE_WORD = 30.0
#: Onsets farther back are no news: by then a change has been told, or is too small to be.
MOST_BACK = 128


@dataclass(frozen=True)
class Weighed:
    """Log posterior weights of every onset (T,), cause (K,), shape (sudden, gradual) and size."""

    first: I64  # (T,) the first check that has the change
    log_by_size: F64  # (T, K, 2, S) prior × likelihood ratio, in the order of `SIZES`

    @cached_property
    def log_weight(self) -> F64:
        """(T, K, 2) of all sizes together."""
        together: F64 = logsumexp(self.log_by_size, axis=3)
        return together

    @property
    def log_sum(self) -> float:
        return float(logsumexp(self.log_by_size))


def weigh(sums: RunningSums, causes: Sequence[Cause], n: int, first: I64) -> Weighed:
    """Weigh changes of the first *n* checks that begin at checks *first*."""
    freedom = NOISE_WORD + float(sums.numbers[n])
    scales = sums.of.scales
    weights = np.full((len(scales), len(first), len(causes), 2, len(SIZES)), -np.inf)
    priors = np.array([[c.prior_sudden, c.prior_gradual] for c in causes])
    with np.errstate(divide="ignore"):
        log_prior = np.log(priors) - np.log(len(SIZES))
    begun = [sums.begun(first, n, ramp=ramp) for ramp in (False, True)]
    log_scale = log_marginals(sums, n)
    log_scale -= logsumexp(log_scale)
    for scale, weight, log_share in zip(scales, weights, log_scale, strict=True):
        factor, side, square = sums.without_change(n, scale)
        left = NOISE_WORD + square
        inverse = solve_triangular(factor, np.eye(len(factor)), lower=True, check_finite=False)
        inverse *= sums.of.scaled(scale)
        for shape, (cross, towards, owns) in enumerate(begun):
            cross = inverse @ cross
            clear = towards - side @ cross
            for (members, at), own in zip(sums.groups, owns, strict=True):
                block = cross[:, :, at].transpose(0, 2, 3, 1)  # (T, causes, p, q)
                gram = own - block @ block.transpose(0, 1, 3, 2)
                ratio = _log_ratio(gram, clear[:, at], left, freedom)
                weight[:, members, shape] = ratio + log_prior[members, shape, None]
        weight += log_share
    return Weighed(first, weights[0] if len(scales) == 1 else logsumexp(weights, axis=0))


def log_marginals(sums: RunningSums, n: int) -> F64:
    """(scales,) log of Student's density of the first *n* checks' readings without a change, by
    how large the standing errors are; everything known integrated out."""
    found = []
    for scale in sums.of.scales:
        factor, _, square = sums.without_change(n, scale)
        spread = float(np.log(np.diag(factor)).sum())
        found.append(log_student(float(sums.numbers[n]), spread, square))
    return np.array(found)


def log_marginal(sums: RunningSums, n: int) -> float:
    """The same, whatever the standing errors' size."""
    found = log_marginals(sums, n)
    return float(logsumexp(found)) - float(np.log(len(found)))


def at_its_share(of: Stack) -> Stack:
    """The stack with its standing errors as large as its readings make likeliest."""
    scales = log_marginals(RunningSums(of), of.n)
    return of.at(of.scales[int(np.argmax(scales))])


def log_student(numbers: float, spread: float, square: float) -> float:
    """The same of so many *numbers* whose covariance has a root of log determinant *spread*, and of
    their *square* by it."""
    freedom = NOISE_WORD + numbers
    scale = float(gammaln(freedom / 2) - gammaln(NOISE_WORD / 2)) - numbers / 2 * np.log(np.pi)
    shape = NOISE_WORD * np.log(NOISE_WORD) - freedom * np.log(NOISE_WORD + square)
    return float(scale - spread + shape / 2)


@dataclass(frozen=True)
class KnownErrors:
    """The q known errors as some checks tell them, in standard deviations of what was known."""

    mean: F64  # (q,)
    covariance: F64  # (q, q), of unit noise
    scale: float  # of all variances: the likelihood integrates it out; here it is at its mean


def known_errors(sums: CheckSums) -> KnownErrors:
    """What checks of these sums tell of them."""
    curvature = sums.curvature + np.eye(len(sums.side))
    covariance = np.asarray(np.linalg.inv(curvature), dtype=np.float64)
    mean = covariance @ sums.side
    left = NOISE_WORD + sums.square - float(sums.side @ mean)
    return KnownErrors(mean, covariance, left / (NOISE_WORD + sums.numbers))


def _log_ratio(gram: F64, side: F64, left: float, freedom: float) -> F64:
    """Log likelihood ratio (T, causes, sizes) of amplitudes with *gram* (T, causes, p, p) and
    *side* (T, causes, p)."""
    if gram.shape[-1] == 1:
        value, along = np.maximum(gram[..., 0], 0.0), side
    else:
        value, vector = np.linalg.eigh(gram)
        value = np.maximum(value, 0.0)
        along = (vector.swapaxes(-1, -2) @ side[..., None])[..., 0]
    found = []
    for size in SIZES:
        curvature = 1.0 + size**2 * value
        quad = np.minimum((size**2 * along**2 / curvature).sum(axis=-1), left * (1 - 1e-12))
        spread = np.log(curvature).sum(axis=-1)
        found.append(-0.5 * spread - 0.5 * freedom * np.log1p(-quad / left))
    return np.stack(found, axis=-1)


def run(
    sums: RunningSums, causes: Sequence[Cause], since: int = 0, until: int | None = None
) -> F64:
    """Log of the alarm's statistic after each check from *since* on, (until − since,)."""
    until = sums.of.n if until is None else until
    statistics = []
    for n in range(since + 1, until + 1):
        first = np.arange(max(since, n - MOST_BACK), n)
        statistics.append(weigh(sums, causes, n, first).log_sum)
    return np.array(statistics)

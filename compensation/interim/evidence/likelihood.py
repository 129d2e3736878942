"""The likelihood ratio of all readings with a change to without: for every cause, onset and shape.

The alarm is Shiryaev's and Roberts's: R = Σ over onsets of the likelihood ratio, each of them
averaged over causes, shapes and sizes by their priors. Without a change R − (checks) is a
martingale of mean zero. So the mean number of checks until R first exceeds A is at least A, for any
poses and artefacts (Pollak, Ann. Statist. 13, 1985; Tartakovsky, Nikiforov, Basseville, Sequential
Analysis, 2014, ch. 7). It is about four times A, because R passes A by a large step. The standing
errors, their size and the scale of the noise have priors and are integrated out, under both
hypotheses alike, so this property remains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import gammaln, logsumexp

from armd.arrays import F64, I64
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.elimination import CheckSums, EliminatedErrors
from armd.compensation.interim.evidence.stack import OnsetSums, RunningSums, Stack

#: About this many checks pass on average until a false alarm.
RUN_LENGTH = 500.0
#: The proven bound, a limit equal to the run length, is not tight: by simulation of the statistic a
#: limit of 120 gives one false alarm in 500 checks (decision 30).
LIMIT = float(np.log(120.0))
#: Sizes of a change, in typical ones; their prior probabilities are equal.
SIZES = (0.1, 0.3, 1.0, 3.0, 10.0)
#: The noise that the calibration states weighs as much as this many numbers.
NOISE_WEIGHT = 30.0
#: Onsets farther back are ignored: a change of that time has been reported, or is too small.
MOST_BACK = 128
#: The number of onsets that are weighed together: their products stay in a processor's cache.
AT_ONCE = 16
#: Entries (i, j), i ≥ j, of symmetric p × p matrices, each an array of its own, and p sides.
Lower = dict[tuple[int, int], F64]


@dataclass(frozen=True)
class Weighed:
    """Log posterior weights of every onset (T,), cause (K,), shape (sudden, gradual) and size."""

    first: I64  # (T,) the first check that has the change
    log_by_size: F64  # (T, K, 2, S) prior × likelihood ratio, in the order of `SIZES`

    @cached_property
    def log_weight(self) -> F64:
        """The log weights (T, K, 2), summed over all sizes."""
        together: F64 = logsumexp(self.log_by_size, axis=3)
        return together

    @property
    def log_sum(self) -> float:
        return float(logsumexp(self.log_by_size))

    @property
    def log_alarm(self) -> float:
        """The largest log sum over as many consecutive onsets as the alarm weighs.

        The alarm's limit holds for such a sum: without a change the sum over all onsets is on
        average as large as their number.
        """
        by_onset = logsumexp(self.log_by_size, axis=(1, 2, 3))
        ends = range(min(MOST_BACK, len(by_onset)), len(by_onset) + 1)
        return max(float(logsumexp(by_onset[max(0, end - MOST_BACK) : end])) for end in ends)


def weigh(sums: RunningSums, causes: Sequence[Cause], n: int, first: I64) -> Weighed:
    """Weigh changes of the first *n* checks that begin at the checks *first*."""
    eliminated = sums.stack.eliminate_errors(sums.sum_first(n))
    priors = np.array([[c.prior_sudden, c.prior_gradual] for c in causes])
    with np.errstate(divide="ignore"):
        log_prior = np.log(priors) - np.log(len(SIZES))
    log_share = _compute_log_marginals(eliminated, int(sums.numbers[n]))
    log_share -= logsumexp(log_share)
    freedom = NOISE_WEIGHT + float(sums.numbers[n])
    weights = np.empty((len(first), len(causes), 2, len(SIZES)))
    for begin in range(0, len(first), AT_ONCE):
        batch = slice(begin, begin + AT_ONCE)
        for shape, begun in enumerate(sums.sum_by_onset(first[batch], n, eliminated.rotation)):
            for members, ratio in _compute_log_ratios(
                sums.groups, begun, eliminated, freedom, log_share
            ):
                weights[batch, members, shape] = ratio + log_prior[members, shape, None]
    return Weighed(first, weights)


def compute_log_sum(logs: F64, axis: int = -1) -> F64:
    """Compute log Σ exp along an axis; for many small arrays `scipy.special.logsumexp`
    is slower.
    """
    largest = logs.max(axis=axis, keepdims=True)
    total: F64 = largest.squeeze(axis) + np.log(np.exp(logs - largest).sum(axis=axis))
    return total


def _compute_log_ratios(
    groups: Sequence[tuple[I64, I64]],
    begun: OnsetSums,
    eliminated: EliminatedErrors,
    freedom: float,
    log_share: F64,
) -> Iterator[tuple[I64, F64]]:
    """Yield each group's causes, and log likelihood ratios (T, causes, sizes) of their changes.

    The sizes of the standing errors have the log shares *log_share* (scales,).
    """
    side_cleared = (
        begun.towards[..., None] - begun.cross @ (eliminated.weights * eliminated.side).T
    )  # (T, C, scales)
    remainder = (NOISE_WEIGHT + eliminated.square)[:, None]
    end = 0
    for (members, columns), gram_of_group in zip(groups, begun.cause_grams, strict=True):
        p = columns.shape[1]
        begin, end = end, end + columns.size
        block = begun.cross[:, begin:end].reshape(*gram_of_group.shape[:3], -1)
        gram = {
            (i, j): gram_of_group[..., i, j, None]
            - (block[:, :, i] * block[:, :, j]) @ eliminated.weights.T
            for i in range(p)
            for j in range(i + 1)
        }
        side = side_cleared[:, begin:end].reshape(*gram_of_group.shape[:3], -1)
        spread, quad = integrate_amplitudes(gram, [side[:, :, i] for i in range(p)], SIZES)
        quad = np.minimum(quad, remainder * (1 - 1e-12))
        logs = -0.5 * (spread + freedom * np.log1p(-quad / remainder)) + log_share[:, None]
        yield members, compute_log_sum(logs, axis=2)


def _compute_log_marginals(eliminated: EliminatedErrors, numbers: int) -> F64:
    """Return the log of Student's density (scales,) of the readings without a change.

    There is one value for each size of the standing errors; all known errors are integrated out.
    """
    pairs = zip(eliminated.spread, eliminated.square, strict=True)
    return np.array([compute_log_student(float(numbers), float(a), float(b)) for a, b in pairs])


def compute_log_marginal(stack: Stack, sums: CheckSums) -> float:
    """Return the log density of the readings of *sums*, averaged over the standing errors' size."""
    logs = _compute_log_marginals(stack.eliminate_errors(sums), sums.numbers)
    return float(logsumexp(logs)) - float(np.log(len(logs)))


def fit_standing_share(stack: Stack) -> Stack:
    """Return the stack whose standing errors have the size that makes its readings likeliest."""
    sums = stack.sum_checks(range(stack.n))
    scales = _compute_log_marginals(stack.eliminate_errors(sums), sums.numbers)
    return stack.rescale(stack.scales[int(np.argmax(scales))])


def compute_log_student(numbers: float, spread: float, square: float) -> float:
    """Return the log of Student's density of *numbers* values, the scale of the noise integrated
    out.

    *spread* is half the log determinant of their covariance, *square* their squared norm by its
    inverse.
    """
    freedom = NOISE_WEIGHT + numbers
    scale = float(gammaln(freedom / 2) - gammaln(NOISE_WEIGHT / 2)) - numbers / 2 * np.log(np.pi)
    shape = NOISE_WEIGHT * np.log(NOISE_WEIGHT) - freedom * np.log(NOISE_WEIGHT + square)
    return float(scale - spread + shape / 2)


@dataclass(frozen=True)
class KnownErrors:
    """Estimates of the q known errors from some checks, in prior standard deviations."""

    mean: F64  # (q,)
    covariance: F64  # (q, q), of unit noise
    scale: float  # factor of all variances, at its mean (the likelihood integrates it out)


def estimate_known_errors(sums: CheckSums) -> KnownErrors:
    """Estimate the known errors from the sums over some checks."""
    curvature = sums.curvature + np.eye(len(sums.side))
    covariance = np.asarray(np.linalg.inv(curvature), dtype=np.float64)
    mean = covariance @ sums.side
    remainder = NOISE_WEIGHT + sums.square - float(sums.side @ mean)
    return KnownErrors(mean, covariance, remainder / (NOISE_WEIGHT + sums.numbers))


def run(
    sums: RunningSums, causes: Sequence[Cause], since: int = 0, until: int | None = None
) -> F64:
    """Return the log of the alarm's statistic after each check from *since* on, (until
    − since,).
    """
    until = sums.stack.n if until is None else until
    statistics = []
    for n in range(since + 1, until + 1):
        first = np.arange(max(since, n - MOST_BACK), n)
        statistics.append(weigh(sums, causes, n, first).log_sum)
    return np.array(statistics)


def integrate_amplitudes(
    gram: Lower, side: Sequence[F64], sizes: Sequence[float]
) -> tuple[F64, F64]:
    """Return log det(I + s² G) and s² yᵀ (I + s² G)⁻¹ y for each of *sizes* s, along a new last
    axis.

    The elimination goes row by row over all matrices at once: they have few rows and there are
    many.
    """
    by = np.array(sizes)
    entry = {place: values[..., None] * by**2 for place, values in gram.items()}
    sides = [values[..., None] * by for values in side]
    determinant = np.ones(())
    quad = np.zeros(())
    for j in range(len(side)):
        # A pivot of I + s² G is at least 1, apart from rounding.
        pivot = np.maximum(1.0 + entry[j, j], 1.0)
        determinant = determinant * pivot
        quad = quad + sides[j] ** 2 / pivot
        for i in range(j + 1, len(side)):
            share = entry[i, j] / pivot
            sides[i] = sides[i] - share * sides[j]
            for k in range(i, len(side)):
                entry[k, i] = entry[k, i] - share * entry[k, j]
    return np.log(determinant), quad

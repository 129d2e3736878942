"""Noise with a memory: a part of the error of one reading is repeated in the next one.

A dirty seat, warm air or a hand that leans on the arm cause errors that last longer than a reading.
A step or a slow course then has a larger score by chance than with independent readings. The
correlation exp(−Δt/τ) of successive rests in one placement is estimated from the residual of a
model with the candidate. Where it is not significant, nothing changes.

The sources, namely the encoders and the hand, have the memory, not the tip. Between two postures
the error of one encoder turns: the tip shows only a part of the encoder's memory, but a step of
that encoder's angle is affected by all of it.

The residual shows less memory than there was: a placement's pose, and above all a base that may
drift during the placement, absorb what is slow. So τ is chosen such that as much memory would be
left in the residual.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import (
    CORRELATION_SIGMAS,
    CORRELATIONS_TRIED,
    LEAST_CORRELATION,
    LEAST_POSITIVE,
    LONGEST_GAPS,
    MOST_CORRELATION,
    MOST_MEMORY_RESTS,
)
from armd.compensation.diagnose.problem.linear import Rests


@dataclass(frozen=True)
class RestOrder:
    """The rests in the order in which they were measured, placement by placement."""

    order: I64  # (n,)
    placement: I64  # (n,) in that order
    time_s: F64  # (n,) in that order
    posture: I64  # (n,) in that order; copies of one posture share more than noise with a memory

    @classmethod
    def from_rests(cls, placement: I64, time_s: F64, posture: I64 | None = None) -> RestOrder:
        """Sort rests by placement (n,) and time (n,).

        *posture* (n,): the posture of each rest; without it each rest has its own.
        """
        order = np.lexsort((time_s, placement))
        posture = np.arange(len(order)) if posture is None else posture
        return cls(order, placement[order], time_s[order], posture[order])

    def pairs(self, lag: int) -> tuple[I64, F64]:
        """Return the first rests of pairs *lag* rests apart in one placement, and the seconds
        between them.

        Rests are numbered by their positions in the order.
        """
        end = len(self.order) - lag
        together = self.placement[lag:] == self.placement[:end]
        first = np.flatnonzero(together & (self.posture[lag:] != self.posture[:end]))
        return first, self.time_s[first + lag] - self.time_s[first]


@dataclass(frozen=True)
class CorrelatedNoise:
    """The time constant τ in s of a noise with memory, and its variance over the stated one."""

    tau_s: float
    variance: float


@dataclass(frozen=True)
class CorrelationEstimator:
    """The rests from which the memory of the noise is estimated.

    *sources* (n, 3, s): how a rest moves, in units of its noise, with each independent source of
    unit variance; zero for rests left out. *absorbed*: for each placement its rests (r,), and the
    columns U (3r, l) by which U Uᵀ was taken from their residual.
    """

    sources: F64
    sequence: RestOrder
    absorbed: Sequence[tuple[I64, F64]] = ()

    @classmethod
    def from_rests(
        cls, rests: Rests, sources: F64, absorbed: Sequence[tuple[I64, F64]]
    ) -> CorrelationEstimator:
        """Make it of rests in the order of their observations."""
        observations = rests.observations
        # Points and orientations are separate sequences.
        group = observations.turned * len(observations.placement_names)
        placement, time_s = observations.placement + group, observations.states.time_s
        sequence = RestOrder.from_rests(placement, time_s, rests.posture)
        return cls(sources, sequence, absorbed)

    def estimate(self, residual: F64) -> CorrelatedNoise | None:
        """Return the memory of the *residual* (n, 3), in units of its noise; None if not
        significant.
        """
        first, second = self._neighbours
        of_sources = np.einsum("nis,ni->ns", self.sources, residual)
        products = float((of_sources[first] * of_sources[second]).sum())
        squared_norm = float((residual**2).sum()) * self._alike
        if not squared_norm > 0.0:
            return None
        measured = products / squared_norm * self._size
        expected_of_none, share = self._expect_shown(0.0)
        if (
            share <= LEAST_CORRELATION
            or (measured - expected_of_none) * np.sqrt(self._alike) < CORRELATION_SIGMAS
        ):
            return None
        expected, variance_shares = self._curve
        rising = slice(int(np.argmax(expected)) + 1)  # beyond it a longer memory shows less
        tried = np.array(_list_tried())
        correlation = float(np.interp(measured, expected[rising], tried[rising]))
        if correlation < LEAST_CORRELATION:  # too much is absorbed for any memory to show
            return None
        variance = float(variance_shares[0] / np.interp(correlation, tried, variance_shares))
        return CorrelatedNoise(-self._usual_s / float(np.log(correlation)), variance)

    @cached_property
    def _neighbours(self) -> tuple[I64, I64]:
        """The rests and their successors, where these are not far off; none without times."""
        first, gap_s = self.sequence.pairs(1)
        if not np.isfinite(gap_s).all() or not len(gap_s) or not np.median(gap_s) > 0.0:
            return first[:0], first[:0]
        close = first[gap_s <= LONGEST_GAPS * np.median(gap_s)]
        return self.sequence.order[close], self.sequence.order[close + 1]

    @cached_property
    def _usual_s(self) -> float:
        first, second = self._neighbours
        return float((self._time_s[second] - self._time_s[first]).mean())

    @cached_property
    def _time_s(self) -> F64:
        """The times (n,) in the order of the rests."""
        time_s = np.empty(len(self.sequence.order))
        time_s[self.sequence.order] = self.sequence.time_s
        return time_s

    @cached_property
    def _alike(self) -> float:
        """The sum of products of rests with their successors if the sources' errors stayed
        unchanged.
        """
        first, second = self._neighbours
        return float(
            (np.einsum("nis,njs->nij", self.sources[first], self.sources[second]) ** 2).sum()
        )

    @cached_property
    def _size(self) -> float:
        return float((self.sources**2).sum())

    @cached_property
    def _curve(self) -> tuple[F64, F64]:
        """The correlation and the share of variance that the residual shows, for each one tried."""
        expected, variance_shares = np.array(
            [self._expect_shown(correlation) for correlation in _list_tried()]
        ).T
        return expected, variance_shares

    def _expect_shown(self, correlation: float) -> tuple[float, float]:
        """Return the correlation that the residual shows of a *correlation*, and the share of
        variance.
        """
        product = removed = 0.0
        following = np.full(len(self.sources), -1)
        following[self._neighbours[0]] = self._neighbours[1]
        for rests, columns in self.absorbed:
            if not 0 < len(rests) <= MOST_MEMORY_RESTS or not columns.size:
                continue  # certified lengths have independent errors, and no rests
            sources = self.sources[rests]
            white = columns
            if correlation > 0.0:
                gap = np.abs(np.subtract.outer(self._time_s[rests], self._time_s[rests]))
                covariance = np.einsum("nis,mjs->nimj", sources, sources)
                covariance *= (correlation ** (gap / self._usual_s))[:, None, :, None]
                white = covariance.reshape(len(columns), len(columns)) @ columns
            u, v = columns.reshape(len(rests), 3, -1), white.reshape(len(rests), 3, -1)
            half = v - 0.5 * u @ (columns.T @ white)  # U Uᵀ V + V U Uᵀ − U Uᵀ V U Uᵀ is U Hᵀ + H Uᵀ
            removed += 2.0 * float((u * half).sum())
            index_of = {rest: k for k, rest in enumerate(rests.tolist())}
            steps = [
                (k, index_of[m]) for k, m in enumerate(following[rests].tolist()) if m in index_of
            ]
            k_first, k_next = np.array(steps, dtype=np.int64).reshape(-1, 2).T
            removed_products = u[k_first] @ half[k_next].transpose(0, 2, 1) + half[k_first] @ u[
                k_next
            ].transpose(0, 2, 1)
            stayed = np.einsum("nis,njs->nij", sources[k_first], sources[k_next])
            product += float((removed_products * stayed).sum())
        share = max(1.0 - removed / self._size, LEAST_CORRELATION)
        return (correlation - product / self._alike) / share, share


def _list_tried() -> list[float]:
    """Return no correlation, those of the table, and the largest that counts as noise."""
    return [0.0, *(c for c in CORRELATIONS_TRIED if c < MOST_CORRELATION), MOST_CORRELATION]


def compute_variance_of_sums(
    weights: F64, sources: F64, tau_s: float, sequence: RestOrder
) -> float:
    """Return the variance of weighted sums of a noise with memory, over that of independent rests.

    *weights* (n, 3, m) and *sources* (n, 3, s) of a noise of unit variance; the variances are
    summed over the m columns.
    """
    of_sources = np.einsum("nis,nim->nsm", sources, weights)
    ordered = of_sources[sequence.order].reshape(len(weights), -1)
    independent = float((ordered**2).sum())
    total = independent
    for lag in range(1, len(weights)):
        first, gap_s = sequence.pairs(lag)
        share = np.exp(-gap_s / tau_s)
        if share.max(initial=0.0) < LEAST_CORRELATION:
            break
        total += 2.0 * float(share @ (ordered[first] * ordered[first + lag]).sum(axis=1))
    return total / max(independent, LEAST_POSITIVE)

"""Noise that remembers: what one reading errs by, the next one errs by again, in part.

A seat not cleaned, warm air, a hand that leans on the arm: errors last longer than a reading. A
step or a slow course then has a larger score by chance than independent readings would give it.
The correlation exp(−Δt/τ) of rests that follow each other in one placement is taken from what is
left beside a candidate; where it is not beyond doubt, nothing changes.

What remembers are the sources, the encoders and the hand, not the tip: between two postures the
error of one encoder turns, so of an encoder's memory the tip shows a part, and a step of that
encoder's angle meets all of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64

#: Standard deviations from which on a correlation is beyond doubt: of independent rests one in a
#: million data sets. Rests further apart than so many usual gaps tell nothing of it.
BEYOND_DOUBT, LONGEST_GAPS = 5.0, 3.0
#: More than this is no noise but something that drifts; less than that has no weight.
MOST, LEAST = 0.9, 0.01


@dataclass(frozen=True)
class Sequence:
    """Rests in the order in which they were measured, placement by placement."""

    order: I64  # (n,)
    placement: I64  # (n,) in that order
    time_s: F64  # (n,) in that order

    @classmethod
    def of(cls, placement: I64, time_s: F64) -> Sequence:
        """By each rest's placement (n,) and time (n,)."""
        order = np.lexsort((time_s, placement))
        return cls(order, placement[order], time_s[order])

    def pairs(self, apart: int) -> tuple[I64, F64]:
        """First rests (positions in the order) of pairs so many rests *apart* in one placement, and
        the seconds between them."""
        first = np.flatnonzero(self.placement[apart:] == self.placement[: len(self.order) - apart])
        return first, self.time_s[first + apart] - self.time_s[first]


def memory_s(left: F64, sources: F64, sequence: Sequence) -> float:
    """The time constant τ in s of what is left (n, 3), in units of its noise; 0: none seen.

    *sources* (n, 3, s): how that moves with each of the independent sources of a rest's noise, of
    unit variance.
    """
    first, gap_s = sequence.pairs(1)
    if not np.isfinite(gap_s).all() or not len(gap_s) or not np.median(gap_s) > 0.0:
        return 0.0
    near = gap_s <= LONGEST_GAPS * np.median(gap_s)
    moves = sources[sequence.order]
    of_sources = np.einsum("nis,ni->ns", moves, left[sequence.order])
    one, two = first[near], first[near] + 1
    # Of products with what they would be if the sources stayed: least squares.
    alike = (np.einsum("nis,njs->nij", moves[one], moves[two]) ** 2).sum()
    square = float((left**2).mean() * alike)
    if not square > 0.0:
        return 0.0
    correlation = float((of_sources[one] * of_sources[two]).sum()) / square
    if correlation * np.sqrt(alike) < BEYOND_DOUBT:
        return 0.0
    return float(-gap_s[near].mean() / np.log(min(correlation, MOST)))


def variance_of_sums(weights: F64, sources: F64, tau_s: float, sequence: Sequence) -> float:
    """Σ over the columns of the variance of weighted sums of a noise of unit variance, by *weights*
    (n, 3, m) and its *sources* (n, 3, s), over the same of independent rests."""
    of_sources = np.einsum("nis,nim->nsm", sources, weights)
    ordered = of_sources[sequence.order].reshape(len(weights), -1)
    alone = float((ordered**2).sum())
    total = alone
    for apart in range(1, len(weights)):
        first, gap_s = sequence.pairs(apart)
        share = np.exp(-gap_s / tau_s)
        if share.max(initial=0.0) < LEAST:
            break
        total += 2.0 * float(share @ (ordered[first] * ordered[first + apart]).sum(axis=1))
    return total / max(alone, 1e-300)

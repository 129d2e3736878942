"""A check that is off by itself: dirt in a seat, another artefact, a hand that slipped.

Its evidence is how much likelier its numbers are if it alone was spoilt than if it was like all
others, whose mean and scatter are known from them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import logsumexp

from armd.arrays import F64
from armd.compensation.interim.evidence.likelihood import NOISE_WORD, log_student
from armd.compensation.interim.evidence.stack import Stack

#: One check in so many is spoilt.
ONE_IN = 50.0
#: How a spoilt check is off: readings scatter so many times more, …
SCATTERS = (2.0, 5.0, 15.0, 50.0, 500.0)
#: … one target lies elsewhere, mm, or every one does (another artefact), mm.
GRAINS_MM = (0.01, 0.05, 0.3)
ELSEWHERE_MM = (0.05, 0.5, 5.0, 50.0)


class Rest:
    """What all other checks know: the known errors, and how large the noise is."""

    def __init__(self, of: Stack, kept: Sequence[int]) -> None:
        self.of = of
        self.sums = of.sums(kept)

    def log_evidence(self, check: int) -> float:
        """Log likelihood ratio that *check*, one of those kept, is spoilt, to that it is not."""
        each = np.array([self.log_densities(check, scale) for scale in self.of.scales])
        rest, usual, off = each.T
        return float(logsumexp(rest + off) - logsumexp(rest + usual))

    def log_densities(self, check: int, scale: float) -> tuple[float, float, float]:
        """Of the other checks; and, they known, of *check* as it usually is and spoilt; the
        standing errors *scale* times as large. But for what is the same of any scale."""
        of, sums = self.of, self.sums
        by = of.scaled(scale)
        known, residual = of.known[check] * by, of.residual[check]
        curvature = by[:, None] * sums.curvature * by + np.eye(len(by)) - known.T @ known
        factor = cho_factor(curvature, check_finite=False)
        side = by * sums.side - known.T @ residual
        at = cho_solve(factor, side, check_finite=False)
        square = sums.square - float(residual @ residual) - float(side @ at)
        left = square + NOISE_WORD
        numbers = sums.numbers - len(residual)
        freedom = NOISE_WORD + numbers
        rest = log_student(float(numbers), float(np.log(np.diag(factor[0])).sum()), square)
        rest -= 0.5 * len(residual) * float(np.log(left))  # the check's own scale
        off = residual - known @ at
        spread = known @ cho_solve(factor, known.T, check_finite=False)
        value, vector = np.linalg.eigh(spread)
        along = vector.T @ off
        value = 1.0 + np.maximum(value, 0.0)
        usual = _log_density(value, along, left, freedom)
        wide = [_log_density(value + s**2 - 1.0, along, left, freedom) for s in SCATTERS]
        targets = vector.T @ of.targets[check]
        single = [
            _log_density_beside(value, along, size * targets[:, 3 * t : 3 * t + 3], left, freedom)
            for t in range(targets.shape[1] // 3)
            for size in GRAINS_MM
        ]
        other = [
            _log_density_beside(value, along, size * targets, left, freedom)
            for size in ELSEWHERE_MM
        ]
        families = [
            float(logsumexp(family)) - np.log(len(family)) for family in (wide, single, other)
        ]
        return rest, usual, float(logsumexp(families)) - float(np.log(len(families)))


def _log_density(variance: F64, along: F64, left: float, freedom: float) -> float:
    """Log of Student's density of *along* (r,), of *variance* (r,) times the noise's."""
    quad = float((along**2 / variance).sum())
    spread = float(np.log(variance).sum())
    return -0.5 * spread - 0.5 * (freedom + len(along)) * float(np.log1p(quad / left))


def _log_density_beside(variance: F64, along: F64, more: F64, left: float, freedom: float) -> float:
    """The same where amplitudes of unit variance move it along *more* (r, m), too."""
    root = 1.0 / np.sqrt(variance)
    whitened, side = more * root[:, None], along * root
    inner = np.eye(more.shape[1]) + whitened.T @ whitened
    factor = np.linalg.cholesky(inner)
    towards = np.linalg.solve(factor, whitened.T @ side)
    quad = max(float(side @ side - towards @ towards), 0.0)
    spread = float(np.log(variance).sum()) + 2.0 * float(np.log(np.diag(factor)).sum())
    return -0.5 * spread - 0.5 * (freedom + len(along)) * float(np.log1p(quad / left))


def spoilt(of: Stack, kept: Sequence[int], doubted: Sequence[int]) -> dict[int, float]:
    """Which of the *doubted* checks among those *kept* are likelier spoilt than not, the worst
    first, with the log of their odds."""
    found: dict[int, float] = {}
    while True:
        left = [i for i in kept if i not in found]
        rest = Rest(of, left)
        odds = {i: rest.log_evidence(i) - np.log(ONE_IN) for i in doubted if i not in found}
        worst = max(odds, key=lambda i: odds[i], default=None)
        if worst is None or odds[worst] <= 0.0:
            return found
        found[worst] = odds[worst]

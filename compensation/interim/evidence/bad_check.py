"""A check that is off by itself: dirt in a seat, another artefact, a hand that slipped.

Its evidence is how much likelier its numbers are if it alone was spoilt than if it was like all
others, whose mean and scatter are known from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.interim.evidence.cleared import CheckSums
from armd.compensation.interim.evidence.likelihood import NOISE_WORD, log_student, log_sum
from armd.compensation.interim.evidence.stack import Stack

#: One check in so many is spoilt.
ONE_IN = 50.0
#: How a spoilt check is off: readings scatter so many times more, …
SCATTERS = (2.0, 5.0, 15.0, 50.0, 500.0)
#: … one target lies elsewhere, mm, or every one does (another artefact), mm.
GRAINS_MM = (0.01, 0.05, 0.3)
ELSEWHERE_MM = (0.05, 0.5, 5.0, 50.0)
#: What is less likely than others by this (natural logarithm) is lost in their rounding.
NEGLIGIBLE = 45.0


class Rest:
    """What all other checks know: the known errors, and how large the noise is."""

    def __init__(self, of: Stack, sums: CheckSums) -> None:
        self.of = of
        self.sums = sums

    def log_evidence(self, check: int) -> float:
        """Log likelihood ratio that *check*, one of those summed up, is spoilt, to that it is
        not."""
        rest, usual, off = self.log_densities(check).T
        return float(log_sum(rest + off) - log_sum(rest + usual))

    def log_densities(self, check: int) -> F64:
        """(scales, 3) of the other checks; and, they known, of *check* as it usually is and spoilt,
        by how large the standing errors are. But for what is the same of any."""
        residual = self.of.residual[check]
        sums = self.sums.without(self.of.known[check], residual)
        known = self.of.cleared(sums)
        lefts = known.square + NOISE_WORD
        rest = [
            log_student(float(sums.numbers), float(spread), float(square))
            - 0.5 * len(residual) * float(np.log(left))  # the check's own scale
            for spread, square, left in zip(known.spread, known.square, lefts, strict=True)
        ]
        turned = self.of.known[check] @ known.rotation.T
        freedom = NOISE_WORD + sums.numbers
        turned_side = known.weights * known.side
        found = np.full((len(rest), 2), -np.inf)
        order = np.argsort(rest)[::-1]
        for k in order:
            # No density of the check itself is over 1: what so little speaks for adds nothing.
            if rest[k] < rest[order[0]] + found[order[0]].min() - NEGLIGIBLE:
                continue
            found[k] = _usual_and_spoilt(
                residual - turned @ turned_side[k],
                (turned * known.weights[k]) @ turned.T,
                self.of.targets[check],
                float(lefts[k]),
                freedom,
            )
        return np.column_stack([rest, found])


def _usual_and_spoilt(
    off: F64, spread: F64, targets: F64, left: float, freedom: float
) -> tuple[float, float]:
    """Log densities of a check that is *off* (r,), known to scatter by *spread* (r, r) beside the
    noise: as it usually is, and spoilt in any of the ways."""
    value, vector = np.linalg.eigh(spread)
    along = vector.T @ off
    value = 1.0 + np.maximum(value, 0.0)
    usual = _log_density(value, along, left, freedom)
    wide = [_log_density(value + s**2 - 1.0, along, left, freedom) for s in SCATTERS]
    root = 1.0 / np.sqrt(value)
    moved, alone = (vector.T @ targets) * root[:, None], along * root
    beside = _Beside(moved.T @ moved, moved.T @ alone, float(alone @ alone), left,
                     freedom + len(along))  # fmt: skip
    spoilt = -0.5 * float(np.log(value).sum())
    count = targets.shape[1] // 3
    single = [beside.log_density(slice(3 * t, 3 * t + 3), GRAINS_MM) for t in range(count)]
    other = beside.log_density(slice(None), ELSEWHERE_MM)
    families = [np.array(wide), spoilt + np.ravel(single), spoilt + other]
    each = [log_sum(family) - np.log(len(family)) for family in families]
    return usual, float(log_sum(np.array(each))) - float(np.log(len(each)))


def _log_density(variance: F64, along: F64, left: float, freedom: float) -> float:
    """Log of Student's density of *along* (r,), of *variance* (r,) times the noise's."""
    quad = float((along**2 / variance).sum())
    spread = float(np.log(variance).sum())
    return -0.5 * spread - 0.5 * (freedom + len(along)) * float(np.log1p(quad / left))


@dataclass(frozen=True)
class _Beside:
    """The same where targets are elsewhere, too, but for the whitened numbers' own determinant."""

    gram: F64  # (m, m) of the targets' columns, whitened
    side: F64  # (m,)
    square: float
    left: float
    freedom: float

    def log_density(self, chosen: slice, sizes: Sequence[float]) -> F64:
        """(sizes,) of Student's, the *chosen* columns' amplitudes of each of *sizes*."""
        value, vector = np.linalg.eigh(self.gram[chosen, chosen])
        by = np.array(sizes)[:, None] ** 2
        wide = 1.0 + by * np.maximum(value, 0.0)
        told = (by * (vector.T @ self.side[chosen]) ** 2 / wide).sum(axis=1)
        quad = np.maximum(self.square - told, 0.0)
        found: F64 = -0.5 * (np.log(wide).sum(axis=1) + self.freedom * np.log1p(quad / self.left))
        return found


def spoilt(of: Stack, sums: CheckSums, doubted: Sequence[int]) -> dict[int, float]:
    """Which of the *doubted* checks among those summed up are likelier spoilt than not, the worst
    first, with the log of their odds."""
    found: dict[int, float] = {}
    while True:
        rest = Rest(of, sums)
        odds = {i: rest.log_evidence(i) - np.log(ONE_IN) for i in doubted if i not in found}
        worst = max(odds, key=lambda i: odds[i], default=None)
        if worst is None or odds[worst] <= 0.0:
            return found
        found[worst] = odds[worst]
        sums = sums.without(of.known[worst], of.residual[worst])

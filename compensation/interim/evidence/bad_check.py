"""Detection of a bad check: dirt in a seat, another artefact, a reading taken beside its seat.

The evidence is the likelihood of its numbers if it alone is spoilt, relative to that if it is like
all others, whose mean and scatter are estimated from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.interim.evidence.elimination import CheckSums
from armd.compensation.interim.evidence.likelihood import (
    NOISE_WEIGHT,
    compute_log_student,
    compute_log_sum,
)
from armd.compensation.interim.evidence.stack import Stack

#: The prior: one check in this many is spoilt.
ONE_IN = 50.0
#: A spoilt check's readings scatter this many times more, …
SCATTERS = (2.0, 5.0, 15.0, 50.0, 500.0)
#: … or one target is displaced, mm, or all targets are (another artefact), mm.
GRAINS_MM = (0.01, 0.05, 0.3)
ELSEWHERE_MM = (0.05, 0.5, 5.0, 50.0)
#: Terms smaller than the largest by this (natural logarithm) are lost in its rounding.
NEGLIGIBLE = 45.0


class OtherChecks:
    """All other checks: their estimates of the known errors and of the noise."""

    def __init__(self, stack: Stack, sums: CheckSums) -> None:
        self.stack = stack
        self.sums = sums

    def log_evidence(self, check: int) -> float:
        """Return the log likelihood ratio that *check* is spoilt, to that it is not.

        The check is one of those summed up.
        """
        others_log, usual, off = self.log_densities(check).T
        return float(compute_log_sum(others_log + off) - compute_log_sum(others_log + usual))

    def log_densities(self, check: int) -> F64:
        """Return log densities (scales, 3) for each size of the standing errors.

        The columns are that of the other checks and, given them, those of *check* as a usual check
        and as a spoilt one. Common constants are omitted.
        """
        residual = self.stack.residual[check]
        sums = self.sums.subtract_check(self.stack.error_columns[check], residual)
        eliminated = self.stack.eliminate_errors(sums)
        lefts = eliminated.square + NOISE_WEIGHT
        others_log = [
            compute_log_student(float(sums.numbers), float(spread), float(squared))
            - 0.5 * len(residual) * float(np.log(remainder))  # scale of the check itself
            for spread, squared, remainder in zip(
                eliminated.spread, eliminated.square, lefts, strict=True
            )
        ]
        turned = self.stack.error_columns[check] @ eliminated.rotation.T
        freedom = NOISE_WEIGHT + sums.numbers
        turned_side = eliminated.weights * eliminated.side
        densities = np.full((len(others_log), 2), -np.inf)
        order = np.argsort(others_log)[::-1]
        for k in order:
            # No log density of the check itself exceeds 0, so such a small weight adds nothing.
            if others_log[k] < others_log[order[0]] + densities[order[0]].min() - NEGLIGIBLE:
                continue
            densities[k] = _weigh_usual_and_spoilt(
                residual - turned @ turned_side[k],
                (turned * eliminated.weights[k]) @ turned.T,
                self.stack.targets[check],
                float(lefts[k]),
                freedom,
            )
        return np.column_stack([others_log, densities])


def _weigh_usual_and_spoilt(
    off: F64, spread: F64, targets: F64, remainder: float, freedom: float
) -> tuple[float, float]:
    """Return the log densities of a check's deviations *off* (r,) if it is usual, and if it is
    spoilt.

    *spread* (r, r) is their covariance in addition to the noise, in units of its variance. A spoilt
    check may be so in any of the ways.
    """
    value, vector = np.linalg.eigh(spread)
    along = vector.T @ off
    value = 1.0 + np.maximum(value, 0.0)
    usual = _compute_log_density(value, along, remainder, freedom)
    wide = [_compute_log_density(value + s**2 - 1.0, along, remainder, freedom) for s in SCATTERS]
    root = 1.0 / np.sqrt(value)
    moved, whitened = (vector.T @ targets) * root[:, None], along * root
    displaced = _Displaced(
        moved.T @ moved,
        moved.T @ whitened,
        float(whitened @ whitened),
        remainder,
        freedom + len(along),
    )
    spoilt = -0.5 * float(np.log(value).sum())
    count = targets.shape[1] // 3
    single = [displaced.log_density(slice(3 * t, 3 * t + 3), GRAINS_MM) for t in range(count)]
    everywhere = displaced.log_density(slice(None), ELSEWHERE_MM)
    families = [np.array(wide), spoilt + np.ravel(single), spoilt + everywhere]
    family_logs = [compute_log_sum(family) - np.log(len(family)) for family in families]
    return usual, float(compute_log_sum(np.array(family_logs))) - float(np.log(len(family_logs)))


def _compute_log_density(variance: F64, along: F64, remainder: float, freedom: float) -> float:
    """Return the log of Student's density of *along* (r,), whose variances are *variance* (r,)
    times the noise's.
    """
    quad = float((along**2 / variance).sum())
    spread = float(np.log(variance).sum())
    return -0.5 * spread - 0.5 * (freedom + len(along)) * float(np.log1p(quad / remainder))


@dataclass(frozen=True)
class _Displaced:
    """Log densities of a check whose targets are displaced, without the determinant of the
    whitening.
    """

    gram: F64  # (m, m) of the targets' whitened columns
    side: F64  # (m,)
    square: float
    remainder: float
    freedom: float

    def log_density(self, chosen: slice, sizes: Sequence[float]) -> F64:
        """Return the log of Student's density (sizes,) for displacements of each of *sizes*.

        Only the *chosen* columns are displaced.
        """
        value, vector = np.linalg.eigh(self.gram[chosen, chosen])
        by = np.array(sizes)[:, None] ** 2
        wide = 1.0 + by * np.maximum(value, 0.0)
        explained = (by * (vector.T @ self.side[chosen]) ** 2 / wide).sum(axis=1)
        quad = np.maximum(self.square - explained, 0.0)
        density: F64 = -0.5 * (
            np.log(wide).sum(axis=1) + self.freedom * np.log1p(quad / self.remainder)
        )
        return density


def find_spoilt(stack: Stack, sums: CheckSums, doubted: Sequence[int]) -> dict[int, float]:
    """Return the *doubted* checks that are likelier spoilt than not, with the log of their odds.

    They are among the checks summed up, and are ordered from the worst on.
    """
    odds_of_spoilt: dict[int, float] = {}
    while True:
        other_checks = OtherChecks(stack, sums)
        odds = {
            i: other_checks.log_evidence(i) - np.log(ONE_IN)
            for i in doubted
            if i not in odds_of_spoilt
        }
        worst = max(odds, key=lambda i: odds[i], default=None)
        if worst is None or odds[worst] <= 0.0:
            return odds_of_spoilt
        odds_of_spoilt[worst] = odds[worst]
        sums = sums.subtract_check(stack.error_columns[worst], stack.residual[worst])

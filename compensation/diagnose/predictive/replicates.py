"""Data sets that a fitted model would give, drawn by the noise that was found and refitted.

A posterior predictive check (Gelman, Meng and Stern, Statistica Sinica 6, 1996), with the residuals
along each joint's motion as what is looked at. The refit is the linear one of the data: placements,
seats, constants and findings take of a drawn set what they took of the measured one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import (
    AXES,
    DRAWS_AT_ONCE,
    DRAWS_SEED,
    LEAST_DRAWS,
    LEAST_VARIANCE_MM2,
    MOST_DRAWN_PRODUCTS,
    MOST_DRAWN_RESTS,
    MOST_DRAWS,
)
from armd.compensation.diagnose.fitting.fit import make_normal_equations
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.whitening import Nuisance, RestNoise


@dataclass(frozen=True)
class Refitted:
    """A model's fit under one noise: what it leaves of the data, and of whatever is drawn."""

    fit: Fit
    residual_mm: F64  # (n, 3) of the data

    @property
    def draws(self) -> int:
        rows, columns = len(self.fit.residual), self.fit.nuisance.columns.size
        fitting = min(
            MOST_DRAWN_PRODUCTS / (rows * max(columns, 1)), MOST_DRAWN_RESTS / (rows / AXES)
        )
        return DRAWS_AT_ONCE * (int(min(max(fitting, LEAST_DRAWS), MOST_DRAWS)) // DRAWS_AT_ONCE)

    def draw_replicates(self) -> Iterator[F64]:
        """(n, 3, r) mm left of drawn sets, some at a time; the same at each call."""
        rng = np.random.default_rng(DRAWS_SEED)
        for _ in range(self.draws // DRAWS_AT_ONCE):
            drawn = self._draw(rng, DRAWS_AT_ONCE)
            amplitudes = self.fit.problem.solve_amplitudes(self.fit.across(drawn))
            residual_mm = drawn - self.fit.nuisance.columns.times(amplitudes)
            n = self.fit.linear.rests.n
            yield residual_mm[: 3 * n].reshape(n, 3, DRAWS_AT_ONCE)

    def _draw(self, rng: np.random.Generator, count: int) -> F64:
        """(N, count) mm: each rest's own noise, what copies of a posture share, certified lengths,
        targets, the base's drift, and a given calibration within its covariance."""
        fit, noise = self.fit, self.fit.noise
        n, posture = fit.linear.rests.n, fit.linear.rests.posture
        independent = rng.normal(size=(n, 3, count))
        common = rng.normal(size=(int(posture.max()) + 1, 3, count))[posture]
        part = noise.shared_part
        unit = np.sqrt(part) * common + np.sqrt(1.0 - part) * independent
        deviation = noise.roots
        lengths = noise.distance_mm[:, None] * rng.normal(size=(len(noise.distance_mm), count))
        drawn = np.concatenate([(deviation @ unit).reshape(3 * n, count), lengths])
        amplitudes = np.zeros((fit.nuisance.columns.size, count))
        slices = [slice(fit.layout.shared, None)]
        if fit.baseline.is_given:
            slices.append(fit.layout.identified)
        for columns in slices:
            sigma = np.sqrt(fit.nuisance.variance[columns])
            amplitudes[columns] = sigma[:, None] * rng.normal(size=(len(sigma), count))
        shaken: F64 = drawn + fit.nuisance.columns.times(amplitudes)
        return shaken


def solve_again(fit: Fit, noise: RestNoise) -> Refitted:
    """The same model solved again by *noise*: that of the model that explains the data best, so
    that what a model lacks does not pass for noise."""
    variance = fit.nuisance.variance.copy()
    variance[fit.layout.drift] = max(noise.drift_mm**2, LEAST_VARIANCE_MM2)
    nuisance = Nuisance(fit.nuisance.columns, variance)
    # Winsorised as it was: one gross error would bend the whole curve.
    problem, side = make_normal_equations(
        nuisance.columns, nuisance, fit.layout, noise, fit.residual
    )
    solution = problem.solve_amplitudes(side)
    fitted = nuisance.columns.times(solution)
    again = replace(
        fit, noise=noise, nuisance=nuisance, problem=problem, solution=solution, fitted=fitted
    )
    n = fit.linear.rests.n
    return Refitted(again, (fit.residual - fitted)[: 3 * n].reshape(n, 3))

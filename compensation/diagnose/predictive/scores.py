"""What the residuals tell of a component that goes by a variable: scores and their information.

A curve that is added to a model makes its residuals likelier. By how much, the score test tells
(Rao, Proc. Cambridge Philos. Soc. 44, 1948): along the component's motion, in units of each rest's
noise, sums of the residuals over the curve's features; and how these sums scatter where the model
is right, after all that absorbs has taken its part of them.

So they scatter among data sets that the model gives, each refitted as the readings were (a
posterior predictive check: Gelman, Meng and Stern, Statistica Sinica 6, 1996). The refit is linear
and weighs by the noise, so that this needs no drawing: with noise of covariance Σ, columns C of
what absorbs, and the information A of their amplitudes, priors included, residuals have the
covariance Σ − C A⁻¹ Cᵀ.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse import csr_array

from armd.arrays import F64, I64, Mask
from armd.compensation.diagnose.constants import AXES, LEAST_SUM, LEAST_VARIANCE_MM2
from armd.compensation.diagnose.fitting.fit import make_normal_equations
from armd.compensation.diagnose.predictive.strength import Misfit, Scatter
from armd.compensation.diagnose.predictive.sums import (
    Functions,
    FunctionSums,
    RestFunctions,
    ShapeSums,
)
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.whitening import Nuisance, RestNoise
from armd.compensation.estimate.linear.linear_model import LinearModel


@dataclass(frozen=True)
class Absorption:
    """Products of a component's motion with the columns of what absorbs, at each rest."""

    problem: LinearModel  # of b columns
    residual: F64  # (b,) what absorbs takes of the residual: as exactly as of a curve
    pieces: Sequence[I64]  # of each piece the rests (k,)
    columns: Sequence[I64]  # and the columns (c,) that are not zero there
    values: Sequence[F64]  # (k, c)

    def absorb(self, sums: RestFunctions, count: int) -> F64:
        """(m, b) what absorbs takes of *count* sums, along directions that are apart."""
        across = np.zeros((self.problem.layout.n, count))
        for number, (columns, values) in enumerate(zip(self.columns, self.values, strict=True)):
            across[columns] += sums.sum_at_piece(number, values).T
        return self.problem.project(across).T

    def compute_variance(self) -> float:
        """What absorbs takes of the variance of all rests."""
        covariance = self.problem.covariance
        return sum(
            float(((values.T @ values) * covariance[np.ix_(columns, columns)]).sum())
            for columns, values in zip(self.columns, self.values, strict=True)
        )


@dataclass(frozen=True)
class Score:
    """Of one component, at each rest."""

    product: F64  # (n,) with the residual before anything is absorbed
    remaining: F64  # (n,) with what the refit leaves of it
    squared_norm: F64  # (n,) of the component's motion
    variance: F64  # (n,) of the product, of the noise that is the rest's own
    shared: csr_array  # (n, s) its parts of each noise of unit variance that copies share
    absorption: Absorption

    @property
    def spread(self) -> float:
        """By how much more the residuals scatter along the component than the model's data sets
        do: the noise found is right over all, not along each."""
        variance = float(self.variance.sum()) + float(self.shared.power(2).sum())
        expected = variance - self.absorption.compute_variance()
        measured = float(self.remaining @ self.remaining)
        return float(np.sqrt(max(measured, LEAST_SUM) / max(expected, LEAST_SUM)))

    def sum_over(self, sums: FunctionSums) -> list[tuple[F64, Scatter]]:
        """Of each variable the sums (m + B,) over its functions, and how they scatter where there
        is noise alone; of too many bins, each by itself."""
        product, variance = sums.sum_at_all(np.stack([self.product, self.variance], axis=1)).T
        absorbed = self.absorption.absorb(sums, len(product))
        values = product - absorbed @ self.absorption.residual
        parts = (values, variance, self._share(sums), absorbed)
        return [
            (of_variable[0], self._compute_scatter(functions, *of_variable[1:]))
            for functions, of_variable in zip(
                sums.variables, zip(*map(sums.divide, parts), strict=True), strict=True
            )
        ]

    def _compute_scatter(
        self, functions: Functions, variance: F64, shared: F64, absorbed: F64
    ) -> Scatter:
        """By sums (m + B,) of the variance, (m + B, s) of what copies share, and (m + B, b) of what
        absorbs takes."""
        unabsorbed = variance + (shared**2).sum(axis=1)
        if not functions.is_together:
            return Scatter(unabsorbed - (absorbed**2).sum(axis=1), unabsorbed)
        information, count = np.diag(variance), functions.count  # bins share no rest
        information[:, :count] = functions.sum_values(functions.columns * self.variance[:, None])
        information[:count, count:] = information[count:, :count].T
        information += shared @ shared.T
        return Scatter(information - absorbed @ absorbed.T, np.diag(information).copy())

    def sum_along(self, shapes: F64) -> tuple[F64, Scatter]:
        """Of each shape (s, m, n) the sums (s, m), and how they scatter."""
        information = (shapes * self.variance) @ shapes.transpose(0, 2, 1)
        rows = shapes.reshape(-1, shapes.shape[2])  # one product of all takes half of one each
        sums = ShapeSums(rows, self.absorption.pieces)
        shared = self._share(sums).reshape(*shapes.shape[:2], -1)
        information += shared @ shared.transpose(0, 2, 1)
        free = np.diagonal(information, axis1=1, axis2=2).copy()
        absorbed = self.absorption.absorb(sums, len(rows)).reshape(*shapes.shape[:2], -1)
        remaining = information - absorbed @ absorbed.transpose(0, 2, 1)
        return shapes @ self.product - absorbed @ self.absorption.residual, Scatter(remaining, free)

    def _share(self, sums: RestFunctions) -> F64:
        """(m, s) parts of sums of each noise that copies share."""
        return sums.sum_at_all(self.shared)


def compute_scores(fit: Fit, moves: F64) -> Iterator[Score]:
    """Of each component, by the tip's motion (n, 3, K)."""
    noise, posture = fit.noise, fit.linear.rests.posture
    white = noise.whitener @ moves
    residual = noise.whiten(np.stack([fit.residual, fit.residual - fit.fitted], axis=1))
    by_rest = residual[: AXES * len(moves)].reshape(-1, AXES, 2)
    absorbed = _absorb_residual(fit)
    columns = fit.nuisance.columns.whitened(noise.whitener, noise.distance_mm)
    pieces = [piece.rests for piece in columns.pieces]
    is_copied = np.bincount(posture)[posture] > 1
    counts = np.broadcast_to(noise.counts, len(moves))
    own_share = np.where(is_copied, counts * (1.0 - noise.shared_part), 1.0)
    shared_size = np.sqrt(noise.shared_part * counts)[is_copied]
    number = np.unique(posture[is_copied], return_inverse=True)[1]
    for motion in np.moveaxis(white, 2, 0):
        squared_norm = (motion**2).sum(axis=1)
        values = [
            np.einsum("nij,ni->nj", piece.values, motion[piece.rests]) for piece in columns.pieces
        ]
        product, remaining = np.einsum("ni,nij->jn", motion, by_rest)
        yield Score(
            product,
            remaining,
            squared_norm,
            squared_norm * own_share,
            _lay_out(shared_size[:, None] * motion[is_copied], is_copied, number),
            Absorption(
                fit.problem, absorbed, pieces, [piece.columns for piece in columns.pieces], values
            ),
        )


def _lay_out(parts: F64, is_copied: Mask, number: I64) -> csr_array:
    """(n, 3 p) of the copies' parts (k, 3), by the *number* (k,) of each one's posture."""
    starts = AXES * np.concatenate([[0], np.cumsum(is_copied)])
    columns = AXES * number[:, None] + np.arange(AXES)
    shape = (len(is_copied), AXES * (int(number.max(initial=-1)) + 1))
    return csr_array((parts.ravel(), columns.ravel(), starts), shape=shape)


def compute_misfit(fit: Fit) -> Misfit:
    """What a model leaves in all, of its rests and of certified lengths."""
    noise = fit.noise
    absorbed = _absorb_residual(fit)
    chi_squared = float((noise.whiten(fit.residual) ** 2).sum() - (absorbed**2).sum())
    counts = np.broadcast_to(noise.counts, noise.freedom.shape)
    free = int(np.isinf(fit.nuisance.variance).sum())
    rows = float(counts @ noise.freedom) + len(noise.distance_mm) - free
    return Misfit(max(chi_squared, 0.0), max(rows, 1.0))


def _absorb_residual(fit: Fit) -> F64:
    """(b,) what absorbs takes of the residual."""
    return fit.problem.project(fit.across(fit.residual))


def solve_again(fit: Fit, noise: RestNoise) -> Fit:
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
    return replace(
        fit, noise=noise, nuisance=nuisance, problem=problem, solution=solution, fitted=fitted
    )

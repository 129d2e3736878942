"""Scores of the residuals along a component over a variable, and their information.

Adding a curve to a model makes its residuals likelier. The score test shows by how much (Rao, Proc.
Cambridge Philos. Soc. 44, 1948). It needs two things, in units of each rest's noise. The first are
sums of the residuals along the component's motion over the curve's features. The second is the
scatter of these sums if the model is right, after all nuisance columns have absorbed their part.

That scatter is the one among data sets of the model, each refitted as the readings were (a
posterior predictive check: Gelman, Meng and Stern, Statistica Sinica 6, 1996). The refit is linear,
so that no data set needs to be drawn. If the refit is weighted by the noise of covariance Σ,
residuals have the covariance Σ − C A⁻¹ Cᵀ, with the nuisance columns C and the information A of
their amplitudes, priors included. It is not where copies of a posture share noise: `copies.py`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import repeat

import numpy as np
from scipy.sparse import csr_array

from armd.arrays import F64
from armd.compensation.diagnose.constants import AXES, LEAST_SUM, LEAST_VARIANCE_MM2
from armd.compensation.diagnose.fitting.fit import make_normal_equations
from armd.compensation.diagnose.predictive.copies import Copies
from armd.compensation.diagnose.predictive.strength import Misfit, Scatter
from armd.compensation.diagnose.predictive.sums import (
    Functions,
    FunctionSums,
    RestFunctions,
    ShapeSums,
    SparseSums,
)
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.whitening import Nuisance, RestNoise
from armd.compensation.estimate.linear.blocks import Piece
from armd.compensation.estimate.linear.linear_model import LinearModel


@dataclass(frozen=True)
class Absorption:
    """Products of a component's motion with the nuisance columns, which absorb a part of it."""

    problem: LinearModel  # of b columns
    residual: F64  # (b,) coordinates of the absorbed part of the residual
    pieces: Sequence[Piece]  # the whitened columns, piece by piece
    values: Sequence[F64]  # of each piece (k, c) products of the motion with its columns

    def project_sums(self, sums: RestFunctions, count: int) -> F64:
        """Return coordinates (m, b) of the absorbed part of *count* sums (orthonormal basis)."""
        return self.problem.project(self._sum_products(sums, count, self.values)).T

    def project_noise(
        self, sums: RestFunctions, count: int, copies: Copies, shared: SparseSums
    ) -> F64:
        """Return covariances (m, b) of *count* sums of noise with its absorbed part."""
        own_noise = [
            copies.own_share[piece.rests, None] * values
            for piece, values in zip(self.pieces, self.values, strict=True)
        ]
        across = self._sum_products(sums, count, own_noise)
        for piece, crossing, part in zip(self.pieces, copies.crossings, copies.parts, strict=True):
            across[piece.columns] += crossing @ shared.select(part).T
        return self.problem.project(across).T

    def _sum_products(self, sums: RestFunctions, count: int, products: Sequence[F64]) -> F64:
        """Return *count* sums (b, m) of products (k, c) of each piece, column by column."""
        across = np.zeros((self.problem.layout.n, count))
        for number, (piece, values) in enumerate(zip(self.pieces, products, strict=True)):
            across[piece.columns] += sums.sum_at_piece(number, values).T
        return across

    def compute_variance(self, copies: Copies | None, sizes: csr_array) -> float:
        """Return by how much absorption reduces the variance of the products, over all rests.

        *sizes* (n, s): of the noises that copies share, in the products.
        """
        covariance, lessened = self.problem.covariance, 0.0
        for number, (piece, values) in enumerate(zip(self.pieces, self.values, strict=True)):
            places = np.ix_(piece.columns, piece.columns)
            gram = values.T @ values
            if copies is None:
                lessened += float((gram * covariance[places]).sum())
                continue
            own_noise = values.T @ (copies.own_share[piece.rests, None] * values)
            shared = sizes[piece.rests][:, copies.parts[number]]
            crossed = own_noise + copies.crossings[number] @ (shared.T @ values)
            lessened += float(2.0 * (crossed * covariance[places]).sum())
            lessened -= float((gram * copies.amplitudes[places]).sum())
        return lessened


@dataclass(frozen=True)
class Score:
    """The products of one component's motion with the residual, at each rest."""

    product: F64  # (n,) before anything is absorbed
    remaining: F64  # (n,) after the refit
    motion: F64  # (n, 3) in units of the noise
    absorption: Absorption
    copies: Copies | None = None

    @cached_property
    def squared_norm(self) -> F64:
        """The squares (n,) of the component's motion."""
        squares: F64 = (self.motion**2).sum(axis=1)
        return squares

    @cached_property
    def variance(self) -> F64:
        """The variance (n,) of each product, of noise that is the rest's own."""
        own_share = 1.0 if self.copies is None else self.copies.own_share
        return self.squared_norm * own_share

    @cached_property
    def _sizes(self) -> csr_array:
        """The sizes (n, s) of the noises that copies share, in the products."""
        if self.copies is None:
            return csr_array((len(self.motion), 0))
        return self.copies.make_sizes(self.motion)

    @property
    def spread(self) -> float:
        """The ratio of the residuals' scatter along the component to that of the model's data sets.

        The estimated noise is right over all components, not along each.
        """
        variance = float(self.variance.sum()) + float(self._sizes.power(2).sum())
        expected = variance - self.absorption.compute_variance(self.copies, self._sizes)
        measured = float(self.remaining @ self.remaining)
        return float(np.sqrt(max(measured, LEAST_SUM) / max(expected, LEAST_SUM)))

    def sum_over(self, sums: FunctionSums) -> list[tuple[F64, Scatter]]:
        """Return for each variable the sums (m + B,) over its functions, and their scatter.

        The scatter is that of noise alone. Where there are too many bins, each counts by itself.
        """
        product, variance = sums.sum_values(np.stack([self.product, self.variance], axis=1)).T
        absorbed = self.absorption.project_sums(sums, len(product))
        values = product - absorbed @ self.absorption.residual
        parts = [*map(sums.split, (values, variance, absorbed))]
        shared: Iterable[F64 | None] = repeat(None)
        noise: Iterable[F64 | None] = repeat(None)
        if self.copies is not None:
            of_copies = sums.sum_sparse(self._sizes)
            crossed = self.absorption.project_noise(sums, len(product), self.copies, of_copies)
            shared, noise = of_copies.split(), sums.split(crossed)
        return [
            (of_variable, self._compute_scatter(functions, *of_parts))
            for functions, of_variable, *of_parts in zip(
                sums.variables, *parts, shared, noise, strict=False
            )
        ]

    def _compute_scatter(
        self,
        functions: Functions,
        variance: F64,
        absorbed: F64,
        shared: F64 | None,
        noise: F64 | None,
    ) -> Scatter:
        """Return the scatter of one variable's sums.

        *variance* (m + B,) and *absorbed* (m + B, b) are sums. If there are copies, *shared*
        (m + B, s) has the sizes of the noises that they share, and *noise* (m + B, b) covariances
        with the absorbed noise.
        """
        unabsorbed = variance + (0.0 if shared is None else (shared**2).sum(axis=1))
        if not functions.is_together:
            lessened = absorbed if noise is None else 2.0 * noise - absorbed @ self._absorbed_noise
            return Scatter(unabsorbed - (absorbed * lessened).sum(axis=1), unabsorbed)
        information, count = np.diag(variance), functions.count  # bins share no rest
        information[:, :count] = functions.sum_values(functions.columns * self.variance[:, None])
        information[:count, count:] = information[count:, :count].T
        if shared is not None:
            information += shared @ shared.T
        return Scatter(self._lessen(information, absorbed, noise), np.diag(information).copy())

    def sum_along(self, shapes: F64) -> tuple[F64, Scatter]:
        """Return the sums (s, m) over each shape (s, m, n), and their scatter."""
        information = (shapes * self.variance) @ shapes.transpose(0, 2, 1)
        rows = shapes.reshape(-1, shapes.shape[2])  # one product of all takes half the time
        sums = ShapeSums(rows, [piece.rests for piece in self.absorption.pieces])
        by_shape = (*shapes.shape[:2], -1)
        absorbed, noise = self.absorption.project_sums(sums, len(rows)).reshape(by_shape), None
        if self.copies is not None:
            of_copies = sums.sum_sparse(self._sizes)
            crossed = self.absorption.project_noise(sums, len(rows), self.copies, of_copies)
            shared, noise = of_copies.columns.reshape(by_shape), crossed.reshape(by_shape)
            information += shared @ shared.transpose(0, 2, 1)
        free = np.diagonal(information, axis1=1, axis2=2).copy()
        values = shapes @ self.product - absorbed @ self.absorption.residual
        return values, Scatter(self._lessen(information, absorbed, noise), free)

    def _lessen(self, information: F64, absorbed: F64, noise: F64 | None) -> F64:
        """Return the covariance (…, m, m) of sums without their *absorbed* part (…, m, b)."""
        across = np.swapaxes(absorbed, -1, -2)
        if noise is None:
            return information - absorbed @ across
        crossed = noise @ across
        absorbed_noise = absorbed @ self._absorbed_noise @ across
        return information - crossed - np.swapaxes(crossed, -1, -2) + absorbed_noise

    @property
    def _absorbed_noise(self) -> F64:
        assert self.copies is not None
        return self.copies.absorbed


def compute_scores(fit: Fit, moves: F64) -> Iterator[Score]:
    """Yield the score of each component, from the tip's motion (n, 3, K)."""
    noise = fit.noise
    white = noise.whitener @ moves
    residual = noise.whiten(np.stack([fit.residual, fit.residual - fit.fitted], axis=1))
    by_rest = residual[: AXES * len(moves)].reshape(-1, AXES, 2)
    absorbed = _absorb_residual(fit)
    columns = fit.nuisance.columns.whitened(noise.whitener, noise.distance_mm)
    copies = Copies.from_fit(fit, columns)
    for motion in np.moveaxis(white, 2, 0):
        values = [
            np.einsum("nij,ni->nj", piece.values, motion[piece.rests]) for piece in columns.pieces
        ]
        product, remaining = np.einsum("ni,nij->jn", motion, by_rest)
        absorption = Absorption(fit.problem, absorbed, columns.pieces, values)
        yield Score(product, remaining, motion, absorption, copies)


def compute_misfit(fit: Fit) -> Misfit:
    """Return a model's misfit over its rests and certified lengths."""
    noise = fit.noise
    absorbed = _absorb_residual(fit)
    chi_squared = float((noise.whiten(fit.residual) ** 2).sum() - (absorbed**2).sum())
    counts = np.broadcast_to(noise.counts, noise.freedom.shape)
    free = int(np.isinf(fit.nuisance.variance).sum())
    rows = float(counts @ noise.freedom) + len(noise.distance_mm) - free
    return Misfit(max(chi_squared, 0.0), max(rows, 1.0))


def _absorb_residual(fit: Fit) -> F64:
    """Return the coordinates (b,) of the absorbed part of the residual."""
    return fit.problem.project(fit.across(fit.residual))


def solve_with_noise(fit: Fit, noise: RestNoise) -> Fit:
    """Solve the same model again in the given *noise*.

    It is the noise of the model that explains the data best. So an error of a poorer model does not
    count as noise.
    """
    variance = fit.nuisance.variance.copy()
    variance[fit.layout.drift] = max(noise.drift_mm**2, LEAST_VARIANCE_MM2)
    nuisance = Nuisance(fit.nuisance.columns, variance)
    # Residuals stay winsorised: one gross error would distort the whole curve.
    problem, side = make_normal_equations(
        nuisance.columns, nuisance, fit.layout, noise, fit.residual
    )
    solution = problem.solve_amplitudes(side)
    fitted = nuisance.columns.times(solution)
    return replace(
        fit, noise=noise, nuisance=nuisance, problem=problem, solution=solution, fitted=fitted
    )

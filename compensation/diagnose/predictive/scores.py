"""What the residuals tell of a component that goes by a variable: scores and their information.

A curve that is added to a model makes its residuals likelier. By how much, the score test tells
(Rao, Proc. Cambridge Philos. Soc. 44, 1948): along the component's motion, in units of each rest's
noise, sums of the residuals over the curve's features; and how these sums scatter where the model
is right, after all that absorbs has taken its part of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.predictive.replicates import Refitted
from armd.compensation.diagnose.predictive.strength import Misfit, Scatter
from armd.compensation.diagnose.predictive.sums import Functions, FunctionSums


@dataclass(frozen=True)
class Score:
    """Of one component, at each rest."""

    product: F64  # (n,) with the residual
    squared_norm: F64  # (n,) of the component's motion
    absorbed: F64  # (n, r) what absorbs takes of it, along apart directions

    def sum_over(self, sums: FunctionSums) -> list[tuple[F64, Scatter]]:
        """Of each variable the sums (m + B,) over its functions, and how they scatter where there
        is noise alone; of too many bins, each by itself."""
        return [
            (product, self._compute_scatter(functions, squared_norm, absorbed))
            for functions, product, squared_norm, absorbed in zip(
                sums.variables,
                *map(sums.sum_values, (self.product, self.squared_norm, self.absorbed)),
                strict=True,
            )
        ]

    def _compute_scatter(self, functions: Functions, squared_norm: F64, absorbed: F64) -> Scatter:
        """By sums (m + B,) of the squared norm, and (m + B, r) of what absorbs takes."""
        if not functions.is_together:
            return Scatter(squared_norm - (absorbed**2).sum(axis=1), squared_norm)
        information, count = np.diag(squared_norm), functions.count  # bins share no rest
        information[:, :count] = functions.sum_values(
            functions.columns * self.squared_norm[:, None]
        )
        information[:count, count:] = information[count:, :count].T
        free = np.diag(information).copy()
        return Scatter(information - absorbed @ absorbed.T, free)

    def sum_along(self, shapes: F64) -> tuple[F64, Scatter]:
        """Of each shape (s, m, n) the sums (s, m), and how they scatter."""
        information = (shapes * self.squared_norm) @ shapes.transpose(0, 2, 1)
        free = np.diagonal(information, axis1=1, axis2=2).copy()
        rows = shapes.reshape(-1, shapes.shape[2])  # one product of all takes half of one each
        absorbed = (rows @ self.absorbed).reshape(*shapes.shape[:2], -1)
        remaining = information - absorbed @ absorbed.transpose(0, 2, 1)
        return shapes @ self.product, Scatter(remaining, free)


def compute_scores(model: Refitted, moves: F64) -> Iterator[Score]:
    """Of each component, by the tip's motion (n, 3, K)."""
    fit, noise, nuisance = model.fit, model.fit.noise, model.fit.nuisance.columns
    white = noise.whitener @ moves
    residual = noise.whiten(fit.residual)[: 3 * len(moves)].reshape(-1, 3)
    coordinates = _absorbed_coordinates(model)
    pieces = nuisance.whitened(noise.whitener, noise.distance_mm).pieces
    for k in range(moves.shape[2]):
        across = np.zeros((nuisance.size, len(moves)))
        for piece in pieces:
            towards = np.einsum("nij,ni->jn", piece.values, white[piece.rests, :, k])
            across[np.ix_(piece.columns, piece.rests)] = towards
        absorbed = fit.problem.project(across).T
        products = (white[:, :, k] * residual).sum(axis=1) - absorbed @ coordinates
        yield Score(products, (white[:, :, k] ** 2).sum(axis=1), absorbed)


def compute_misfit(model: Refitted) -> Misfit:
    """What a model leaves in all, of its rests and of certified lengths."""
    fit, noise = model.fit, model.fit.noise
    chi_squared = float(
        (noise.whiten(fit.residual) ** 2).sum() - (_absorbed_coordinates(model) ** 2).sum()
    )
    counts = np.broadcast_to(noise.counts, noise.freedom.shape)
    free = int(np.isinf(fit.nuisance.variance).sum())
    rows = float(counts @ noise.freedom) + len(noise.distance_mm) - free
    return Misfit(max(chi_squared, 0.0), max(rows, 1.0))


def _absorbed_coordinates(model: Refitted) -> F64:
    """Coordinates of what absorbs takes of the residual, as exactly as of a curve."""
    return model.fit.problem.project(model.fit.across(model.fit.residual))

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

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import MOST_TOGETHER
from armd.compensation.diagnose.predictive.replicates import Refitted
from armd.compensation.diagnose.predictive.strength import Misfit, Scatter


@dataclass(frozen=True)
class Score:
    """Of one component, at each rest."""

    product: F64  # (n,) with the residual
    squared_norm: F64  # (n,) of the component's motion
    absorbed: F64  # (n, r) what absorbs takes of it, along apart directions

    def sum_over(self, features: F64, order: I64, starts: I64) -> tuple[F64, Scatter]:
        """Sums (m + B,) over features (k, m) and bins of the rests in *order*, and how they scatter
        where there is noise alone; of too many bins, each by itself and no feature."""
        together = features.shape[1] + len(starts) <= MOST_TOGETHER
        columns = features if together else features[:, :0]
        squared_norm = self.squared_norm[order]
        weighed = columns * squared_norm[:, None]

        def compute_sums(values: F64) -> F64:
            parts = [columns.T @ values]
            if len(starts):
                parts.append(np.add.reduceat(values, starts, axis=0))
            return np.concatenate(parts)

        absorbed = compute_sums(self.absorbed[order])
        count = columns.shape[1]
        if not together:
            free = compute_sums(squared_norm)
            return compute_sums(self.product[order]), Scatter(
                free - (absorbed**2).sum(axis=1), free
            )
        information = np.zeros((count + len(starts),) * 2)
        information[:, :count] = compute_sums(weighed)
        information[:count, count:] = information[count:, :count].T
        if len(starts):
            diagonal = count + np.arange(len(starts))
            information[diagonal, diagonal] = np.add.reduceat(squared_norm, starts)
        free = np.diag(information).copy()
        return compute_sums(self.product[order]), Scatter(information - absorbed @ absorbed.T, free)

    def sum_along(self, shapes: F64) -> tuple[F64, Scatter]:
        """Of each shape (s, n, m) the sums (s, m), and how they scatter."""
        turned = shapes.transpose(0, 2, 1)
        information = turned @ (shapes * self.squared_norm[:, None])
        free = np.diagonal(information, axis1=1, axis2=2).copy()
        absorbed = turned @ self.absorbed
        remaining = information - absorbed @ absorbed.transpose(0, 2, 1)
        return turned @ self.product, Scatter(remaining, free)


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

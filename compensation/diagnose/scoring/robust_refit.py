"""How well candidates explain what was clipped, each with the tails clipped about its own fit.

The search clips what stands far from the fit so far. A strong cause that few rests show is then
clipped as if it were a tail, and what is left of it has another shape: a drag by the square of the
rate looks linear in it. Before a strong candidate is named, the likeliest are each fitted with the
tails clipped about that very fit (Huber's loss by reweighting).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import LEAST_GAINED, MOST_GAINED, REWEIGHTINGS
from armd.compensation.diagnose.problem.amplitudes import compute_broadest_sd
from armd.compensation.diagnose.problem.signatures import make_finding_columns
from armd.compensation.diagnose.scoring.projection import Projection
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.linear.linear_model import LinearModel
from armd.compensation.estimate.noise.robust import (
    WINSOR_AT,
    compute_huber_loss,
    compute_huber_weights,
)


def compute_unclipped_gain(
    candidates: Sequence[Candidate], weight: F64, projection: Projection
) -> F64:
    """(C,) by how much each one's gain in log likelihood is larger than on the clipped residual.

    Zero where it could not matter: for those of a log *weight* (C,) too far below the best.
    """
    _, residuals = projection.clear_of_all(_residuals(projection))
    in_tails = _huber(residuals[:, 0], projection) - _huber(residuals[:, 1], projection)
    is_close = weight >= weight.max() - MOST_GAINED * in_tails
    gains = np.zeros(len(candidates))
    if is_close.sum() > 1:
        nothing = _absorbing(projection)
        without_candidate = nothing.robust()
        before = without_candidate.loss - nothing.square_of_clipped()
        for i in map(int, np.flatnonzero(is_close)):
            with_candidate = nothing.joined(candidates[i])
            gains[i] = before - (
                with_candidate.robust(without_candidate.weight_loss).loss
                - with_candidate.square_of_clipped()
            )
    return gains


def clip_about(candidate: Candidate, projection: Projection) -> Projection:
    """The projection, its residual clipped about the fit with a candidate in the model."""
    fit = projection.fit
    whitened_residual = _absorbing(projection).joined(candidate).robust().residual
    size = np.linalg.norm(whitened_residual, axis=1) * fit.noise.stretch
    excess = whitened_residual * (1.0 - compute_huber_weights(size))[:, None]
    residual = fit.raw_residual.copy()
    clipped = size > WINSOR_AT
    residual[: 3 * len(whitened_residual)].reshape(-1, 3)[clipped] -= np.linalg.solve(
        fit.noise.whitener[clipped], excess[clipped][:, :, None]
    )[:, :, 0]
    return replace(projection, fit=replace(fit, residual=residual))


def _residuals(projection: Projection) -> F64:
    """(N, 2) as measured, and clipped."""
    return np.stack([projection.fit.raw_residual, projection.fit.residual], axis=1)


def _huber(residual: F64, projection: Projection) -> float:
    """Huber's loss of residuals (N,), of each rest's components together."""
    end = 3 * projection.fit.linear.rests.n
    stretch = projection.fit.noise.stretch
    size = np.linalg.norm(residual[:end].reshape(-1, 3), axis=1) * stretch
    return compute_huber_loss(size, stretch) + 0.5 * float((residual[end:] ** 2).sum())


@dataclass(frozen=True)
class _Robust:
    """A fit of least Huber's loss: the loss, and of each rest what is left (n, 3) and by how much
    its weight is less than one (n,)."""

    loss: float
    residual: F64
    weight_loss: F64


@dataclass(frozen=True)
class _Problem:
    """Columns that explain a residual, their amplitudes held by a prior: those that absorb, and a
    candidate's beside them, for what absorbs is many megabytes and stays where it is."""

    projection: Projection
    absorbing: F64  # (N, b)
    candidate_columns: F64  # (N, m)
    model: LinearModel
    residuals: F64  # (N, 2) as measured, and clipped
    sides: F64  # (b + m, 2) products with these

    def joined(self, candidate: Candidate) -> _Problem:
        """With a candidate's columns, amplitudes of up to the largest plausible size."""
        projection = self.projection
        columns = make_finding_columns(projection.fit.linear, [candidate], projection.arm)[0]
        candidate_columns = projection.clear_of_cells(columns)
        largest_amplitudes = np.array([compute_broadest_sd(column) for column in candidate.columns])
        return replace(
            self,
            candidate_columns=candidate_columns,
            model=self.model.joined(
                "candidate",
                candidate_columns.T @ candidate_columns,
                self.absorbing.T @ candidate_columns,
                largest_amplitudes**2,
            ),
            sides=np.vstack([self.sides, candidate_columns.T @ self.residuals]),
        )

    def square_of_clipped(self) -> float:
        """Least half of the clipped residual's sum of squares, what holds the amplitudes
        included."""
        towards = self.model.project(self.sides[:, 1])
        clipped = self.residuals[:, 1]
        return 0.5 * float(clipped @ clipped - towards @ towards)

    def robust(self, weight_loss: F64 | None = None) -> _Robust:
        """The fit of least Huber's loss to what was measured, by reweighting; *weight_loss* (n,):
        by how much rests weigh less than one to begin with. The loss has one minimum only."""
        n = self.projection.fit.linear.rests.n
        weight_loss = np.zeros(n) if weight_loss is None else weight_loss
        raw, b = self.residuals[:, 0], self.absorbing.shape[1]
        best = _Robust(np.inf, raw[: 3 * n].reshape(-1, 3), weight_loss)
        for _ in range(REWEIGHTINGS):
            rows = np.flatnonzero(np.repeat(weight_loss > 0, 3))
            columns = np.hstack([self.absorbing[rows], self.candidate_columns[rows]])
            weighted_columns = columns * np.repeat(weight_loss[weight_loss > 0], 3)[:, None]
            weighted = replace(self.model, gram=self.model.gram - weighted_columns.T @ columns)
            solution = weighted.explain(self.sides[:, 0] - weighted_columns.T @ raw[rows])
            residual = raw - self.absorbing @ solution[:b] - self.candidate_columns @ solution[b:]
            prior = float(solution**2 @ (1.0 / self.model.variance))
            loss = _huber(residual, self.projection) + 0.5 * prior
            gained = best.loss - loss
            of_rests = residual[: 3 * n].reshape(-1, 3)
            size = np.linalg.norm(of_rests, axis=1) * self.projection.fit.noise.stretch
            weight_loss = 1.0 - compute_huber_weights(size)
            if gained > 0.0:
                best = _Robust(loss, of_rests, weight_loss)
            if gained < LEAST_GAINED:
                break
        return best


def _absorbing(projection: Projection) -> _Problem:
    """What placements share of what absorbs."""
    columns = projection.cleared[:, :-1]
    # Columns clear of the cells are what is weighed here: their own lengths are the yardstick.
    shared = projection.shared
    model = LinearModel.from_products(shared.layout, projection.within, shared.variance)
    residuals = projection.clear_of_cells(_residuals(projection))
    nothing = np.empty((len(columns), 0))
    return _Problem(projection, columns, nothing, model, residuals, columns.T @ residuals)

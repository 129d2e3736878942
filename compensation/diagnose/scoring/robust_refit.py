"""The fit of candidates to clipped readings, each with the outliers clipped about its own fit.

The search clips readings that are far from the current fit. A strong cause that few rests show is
then clipped as if it were an outlier, and the rest of it has another shape: drag by the square of
the rate looks linear in it. So before a strong candidate is named, the likeliest ones are each
fitted with the outliers clipped about that fit (Huber's loss by reweighting).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import LEAST_GAINED, MOST_GAINED, REWEIGHTINGS
from armd.compensation.diagnose.problem.signatures import make_finding_columns
from armd.compensation.diagnose.scoring.projection import Projection
from armd.compensation.effects.effect import Candidate
from armd.compensation.effects.sizes import compute_broadest_sd
from armd.compensation.estimate.linear.linear_model import LinearModel
from armd.compensation.estimate.noise.robust import (
    WINSOR_AT,
    compute_huber_loss,
    compute_huber_weights,
)


def compute_unclipped_gain(
    candidates: Sequence[Candidate], weight: F64, projection: Projection
) -> F64:
    """Return by how much each candidate's gain (C,) in log likelihood exceeds that on clipped
    residuals.

    It is zero where it could not matter: for a log *weight* (C,) too far below the best.
    """
    _, residuals = projection.clear_of_all(_residuals(projection))
    in_tails = _huber(residuals[:, 0], projection) - _huber(residuals[:, 1], projection)
    is_close = weight >= weight.max() - MOST_GAINED * in_tails
    gains = np.zeros(len(candidates))
    if is_close.sum() > 1:
        nothing = _absorbing(projection)
        without_candidate = nothing.robust()
        before = without_candidate.loss - nothing.compute_clipped_loss()
        for i in map(int, np.flatnonzero(is_close)):
            with_candidate = nothing.joined(candidates[i])
            gains[i] = before - (
                with_candidate.robust(without_candidate.weight_deficit).loss
                - with_candidate.compute_clipped_loss()
            )
    return gains


def clip_about(candidate: Candidate, projection: Projection) -> Projection:
    """Clip the projection's residual about the fit with a candidate in the model."""
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
    """Return the residual as measured, and clipped (N, 2)."""
    return np.stack([projection.fit.raw_residual, projection.fit.residual], axis=1)


def _huber(residual: F64, projection: Projection) -> float:
    """Return Huber's loss of residuals (N,), by the length of each rest's residual."""
    end = 3 * projection.fit.linear.rests.n
    stretch = projection.fit.noise.stretch
    size = np.linalg.norm(residual[:end].reshape(-1, 3), axis=1) * stretch
    return compute_huber_loss(size, stretch) + 0.5 * float((residual[end:] ** 2).sum())


@dataclass(frozen=True)
class _Robust:
    """A fit of least Huber's loss.

    *residual* (n, 3): of each rest; *weight_deficit* (n,): by how much the rest's weight is below
    one.
    """

    loss: float
    residual: F64
    weight_deficit: F64


@dataclass(frozen=True)
class _Problem:
    """Columns that explain a residual, with priors of their amplitudes.

    A candidate's columns are separate from those that absorb, which are many megabytes and are not
    copied.
    """

    projection: Projection
    absorbing: F64  # (N, b)
    candidate_columns: F64  # (N, m)
    model: LinearModel
    residuals: F64  # (N, 2) as measured, and clipped
    sides: F64  # (b + m, 2) products of all columns with the residuals

    def joined(self, candidate: Candidate) -> _Problem:
        """Add a candidate's columns, with amplitudes of up to the largest plausible size."""
        projection = self.projection
        columns = make_finding_columns(projection.fit.linear, [candidate], projection.arm)[0]
        candidate_columns = projection.clear_of_cells(columns)
        largest_amplitudes = np.array([compute_broadest_sd(column) for column in candidate.columns])
        return replace(
            self,
            candidate_columns=candidate_columns,
            model=self.model.add_block(
                "candidate",
                candidate_columns.T @ candidate_columns,
                self.absorbing.T @ candidate_columns,
                largest_amplitudes**2,
            ),
            sides=np.vstack([self.sides, candidate_columns.T @ self.residuals]),
        )

    def compute_clipped_loss(self) -> float:
        """Return the least half sum of squares of the clipped residual, with the priors' part."""
        towards = self.model.project(self.sides[:, 1])
        clipped = self.residuals[:, 1]
        return 0.5 * float(clipped @ clipped - towards @ towards)

    def robust(self, weight_deficit: F64 | None = None) -> _Robust:
        """Fit with least Huber's loss to what was measured, by reweighting.

        *weight_deficit* (n,): by how much the first weights are below one. The loss has only one
        minimum.
        """
        n = self.projection.fit.linear.rests.n
        weight_deficit = np.zeros(n) if weight_deficit is None else weight_deficit
        raw, b = self.residuals[:, 0], self.absorbing.shape[1]
        best = _Robust(np.inf, raw[: 3 * n].reshape(-1, 3), weight_deficit)
        for _ in range(REWEIGHTINGS):
            rows = np.flatnonzero(np.repeat(weight_deficit > 0, 3))
            columns = np.hstack([self.absorbing[rows], self.candidate_columns[rows]])
            weighted_columns = columns * np.repeat(weight_deficit[weight_deficit > 0], 3)[:, None]
            weighted = replace(self.model, gram=self.model.gram - weighted_columns.T @ columns)
            solution = weighted.explain(self.sides[:, 0] - weighted_columns.T @ raw[rows])
            residual = raw - self.absorbing @ solution[:b] - self.candidate_columns @ solution[b:]
            prior = float(solution**2 @ (1.0 / self.model.variance))
            loss = _huber(residual, self.projection) + 0.5 * prior
            gained = best.loss - loss
            of_rests = residual[: 3 * n].reshape(-1, 3)
            size = np.linalg.norm(of_rests, axis=1) * self.projection.fit.noise.stretch
            weight_deficit = 1.0 - compute_huber_weights(size)
            if gained > 0.0:
                best = _Robust(loss, of_rests, weight_deficit)
            if gained < LEAST_GAINED:
                break
        return best


def _absorbing(projection: Projection) -> _Problem:
    """Make the problem of the absorbing columns that placements share."""
    columns = projection.cleared[:, :-1]
    # The columns here are clear of the cells: lengths are theirs, not those before clearing.
    shared = projection.shared
    model = LinearModel.from_products(shared.layout, projection.within, shared.variance)
    residuals = projection.clear_of_cells(_residuals(projection))
    nothing = np.empty((len(columns), 0))
    return _Problem(projection, columns, nothing, model, residuals, columns.T @ residuals)

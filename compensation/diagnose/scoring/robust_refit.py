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
import numpy.typing as npt

from armd.compensation.diagnose.fitting.fit import finding_columns
from armd.compensation.diagnose.fitting.nuisance import most_plausible
from armd.compensation.diagnose.scoring.projection import Projection
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.linear_model import LinearModel
from armd.compensation.estimate.robust import WINSOR_AT, huber_loss, huber_weights

F64 = npt.NDArray[np.float64]

REWEIGHTINGS = 6
#: A candidate hardly gains more by its own tails than so many times what was clipped.
MOST_GAINED = 2.0


def unclipped(candidates: Sequence[Candidate], weight: F64, projection: Projection) -> F64:
    """(C,) by how much each one's gain in log likelihood is larger than on the clipped residual.

    Zero where it could not matter: for those of a log *weight* (C,) too far below the best.
    """
    _, left = projection.clear_of_all(_residuals(projection))
    in_tails = _huber(left[:, 0], projection) - _huber(left[:, 1], projection)
    near = weight >= weight.max() - MOST_GAINED * in_tails
    more = np.zeros(len(candidates))
    if near.sum() > 1:
        raw, clipped = projection.clear_of_cells(_residuals(projection)).T
        nothing = _absorbing(projection)
        before = nothing.robust(raw)[1] - nothing.square(clipped)
        for i in map(int, np.flatnonzero(near)):
            both = nothing.joined(candidates[i], projection)
            more[i] = before - (both.robust(raw)[1] - both.square(clipped))
    return more


def clipped_about(candidate: Candidate, projection: Projection) -> Projection:
    """The projection, its residual clipped about the fit with a candidate in the model."""
    fit = projection.fit
    both = _absorbing(projection).joined(candidate, projection)
    raw = projection.clear_of_cells(fit.raw_residual[:, None])[:, 0]
    solution, _ = both.robust(raw)
    n = fit.linear.rests.n
    left = (raw - both.clear @ solution)[: 3 * n].reshape(n, 3)
    size = np.linalg.norm(left, axis=1)
    less = left * (1.0 - huber_weights(size))[:, None]
    residual = fit.raw_residual.copy()
    clipped = size > WINSOR_AT
    residual[: 3 * n].reshape(n, 3)[clipped] -= np.linalg.solve(
        fit.noise.whitener[clipped], less[clipped][:, :, None]
    )[:, :, 0]
    return replace(projection, fit=replace(fit, residual=residual))


def _residuals(projection: Projection) -> F64:
    """(N, 2) as measured, and clipped."""
    return np.stack([projection.fit.raw_residual, projection.fit.residual], axis=1)


def _huber(left: F64, projection: Projection) -> float:
    """Huber's loss of residuals (N,), of each rest's components together."""
    end = 3 * projection.fit.linear.rests.n
    size = np.linalg.norm(left[:end].reshape(-1, 3), axis=1)
    return huber_loss(size) + 0.5 * float((left[end:] ** 2).sum())


@dataclass(frozen=True)
class _Problem:
    """Columns that explain a residual, their amplitudes held by a prior."""

    projection: Projection
    clear: F64  # (N, b)
    model: LinearModel

    def joined(self, candidate: Candidate, projection: Projection) -> _Problem:
        """With a candidate's columns, amplitudes of up to the largest plausible size."""
        columns = finding_columns(projection.fit.linear, [candidate], projection.arm)[0]
        own = projection.clear_of_cells(columns)
        most = np.array([most_plausible(column) for column in candidate.columns])
        return _Problem(
            projection,
            np.hstack([self.clear, own]),
            self.model.joined("candidate", own.T @ own, self.clear.T @ own, most**2),
        )

    def square(self, residual: F64) -> float:
        """Least half of the sum of squares, what holds the amplitudes included."""
        towards = self.model.project(self.clear.T @ residual)
        return 0.5 * float(residual @ residual - towards @ towards)

    def robust(self, residual: F64) -> tuple[F64, float]:
        """The solution (b,) of least Huber's loss, and that loss."""
        n = self.projection.fit.linear.rests.n
        side = self.clear.T @ residual
        less = np.zeros(n)  # by how much a rest's weight is less than one
        best: tuple[F64, float] = np.zeros(len(side)), np.inf
        for _ in range(REWEIGHTINGS):
            rows = np.flatnonzero(np.repeat(less > 0, 3))
            taken = self.clear[rows] * np.repeat(less[less > 0], 3)[:, None]
            weighted = replace(self.model, gram=self.model.gram - taken.T @ self.clear[rows])
            solution = weighted.explain(side - taken.T @ residual[rows])
            left = residual - self.clear @ solution
            held = float(solution**2 @ (1.0 / self.model.variance))
            loss = _huber(left, self.projection) + 0.5 * held
            if loss < best[1]:
                best = solution, loss
            size = np.linalg.norm(left[: 3 * n].reshape(-1, 3), axis=1)
            less = 1.0 - huber_weights(size)
        return best


def _absorbing(projection: Projection) -> _Problem:
    """What placements share of what absorbs."""
    clear = projection.clear[:, :-1]
    shared = projection.shared
    # Columns clear of the cells are what is weighed here: their own lengths are the yardstick.
    model = LinearModel.of_products(shared.layout, clear.T @ clear, shared.variance)
    return _Problem(projection, clear, model)

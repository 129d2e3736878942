"""The solution of a linear least-squares problem by directions: which are known, and how well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, Mask

#: A direction's sum of squares below this, relative to the largest, is rounding. Data with noise
#: hardly come near: 1 µm in 20 000 readings, and a tenth of a departure, are 4e-12.
ROUNDING = 1e-12
#: A direction known worse than a tenth of its plausible departure is not known.
LEAST_KNOWN = 10.0


@dataclass(frozen=True)
class Solution:
    """One linear least-squares solution, in scaled unknowns."""

    step: F64  # (C,) in the unknowns' own units
    singular_values: F64  # (C,) of the whitened columns, descending
    is_known: Mask  # (C,) directions that are known
    prior: Mask  # (C,) directions along which the nominal values count as one more reading
    directions: F64  # (C, C) columns: directions in scaled unknowns
    scale: F64  # (C,) plausible departures
    gain: float  # by how much the sum of squares falls, to first order

    @property
    def rank(self) -> int:
        return int(self.is_known.sum())

    @property
    def null(self) -> F64:
        """The directions (C, C − rank) that readings do not determine, in plausible departures."""
        return self.directions[:, ~self.is_known]

    @property
    def effective_rank(self) -> float:
        """The number of unknowns that the readings determined, by their shares beside the prior."""
        curvature = self.singular_values**2
        shares = curvature[curvature > 0] / (curvature + self.prior)[curvature > 0]
        return float(shares.sum())

    def compute_nominal_cost(self, departure: F64) -> float:
        """Return the cost of a *departure* (C,) along directions with the nominal prior."""
        along = self.directions[:, self.prior].T @ (departure / self.scale)
        return float(along @ along)

    @property
    def known_step(self) -> F64:
        """The step (C,) along known directions only."""
        known_directions = self.directions[:, self.is_known]
        step: F64 = self.scale * (
            known_directions @ (known_directions.T @ (self.step / self.scale))
        )
        return step

    @property
    def root(self) -> F64:
        """The matrix R (C, C) with R Rᵀ the covariance, directions that move no point included."""
        root: F64 = self.scale[:, None] * self.directions / np.sqrt(self._curvature)
        return root

    @property
    def _curvature(self) -> F64:
        curvature: F64 = self.singular_values**2 + self.prior
        return curvature

    def compute_known_covariance(self) -> F64:
        """Return the covariance (C, C) of the known directions alone, in the unknowns' units."""
        return self._covariance(self.directions[:, self.is_known], self.is_known)

    def covariance(self, gauge: F64) -> F64:
        """Return the covariance (C, C) in the unknowns' own units, zero along *gauge* (C, k).

        The gauge moves no point. Other directions that the readings do not determine are as
        uncertain as a plausible departure, not certain.
        """
        without_gauge = self.directions - gauge @ (gauge.T @ self.directions)
        return self._covariance(without_gauge, np.ones_like(self.is_known))

    def _covariance(self, directions: F64, chosen: Mask) -> F64:
        root = directions / np.sqrt(self._curvature[chosen])
        root = self.scale[:, None] * root
        covariance: F64 = root @ root.T
        return covariance


def solve_with_prior(
    gram: F64, side: F64, scale: F64, nominal: F64, damping: float = 0.0, along_all: bool = False
) -> Solution:
    """Solve as `LinearModel.solve_with_prior`, from products of columns (C, C) and residual (C,).

    *scale* (C,): plausible departures.
    """
    values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
    curvature, directions = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    largest = float(curvature.max(initial=0.0))
    is_known = curvature > max(LEAST_KNOWN**2, ROUNDING * largest)
    prior = ~is_known | along_all
    slope = directions.T @ (scale * side) + prior * (directions.T @ (nominal / scale))
    leaned = curvature + prior
    step = scale * (directions @ (slope / (leaned + damping * largest)))
    gain = float(np.sum(slope**2 / leaned))
    return Solution(step, np.sqrt(curvature), is_known, prior, directions, scale, gain)

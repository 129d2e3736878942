"""A linear least-squares problem solved along its directions: what is known, and how well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, Mask

#: A direction's sum of squares below this, relative to the largest, is rounding. Hardly anything
#: with a noise comes near: 1 µm in 20 000 readings, and a tenth of a departure, are 4e-12.
ROUNDING = 1e-12
#: A direction known worse than a tenth of its plausible departure is not known.
LEAST_KNOWN = 10.0


@dataclass(frozen=True)
class Solution:
    """One linear least-squares solution, in scaled unknowns."""

    step: F64  # (C,) in the unknowns' own units
    singular_values: F64  # (C,) of the whitened columns, descending
    is_known: Mask  # (C,) which directions are known
    prior: Mask  # (C,) along which the drawing counts as one more reading
    directions: F64  # (C, C) columns: directions in scaled unknowns
    scale: F64  # (C,) plausible departures
    gain: float  # by how much the sum of squares falls, to first order

    @property
    def rank(self) -> int:
        return int(self.is_known.sum())

    @property
    def null(self) -> F64:
        """(C, C − rank) directions the readings do not know, in plausible departures."""
        return self.directions[:, ~self.is_known]

    @property
    def effective_rank(self) -> float:
        """How many unknowns the readings told, by the share they had in each beside the drawing."""
        curvature = self.singular_values**2
        shares = curvature[curvature > 0] / (curvature + self.prior)[curvature > 0]
        return float(shares.sum())

    def off_drawing(self, departure: F64) -> float:
        """What a *departure* (C,) from the drawing costs along directions that lean on it."""
        along = self.directions[:, self.prior].T @ (departure / self.scale)
        return float(along @ along)

    @property
    def known_step(self) -> F64:
        """(C,) the step along what is known, nothing beside it."""
        known_directions = self.directions[:, self.is_known]
        step: F64 = self.scale * (
            known_directions @ (known_directions.T @ (self.step / self.scale))
        )
        return step

    @property
    def root(self) -> F64:
        """(C, C) R with R Rᵀ the covariance, what moves no point included."""
        root: F64 = self.scale[:, None] * self.directions / np.sqrt(self._curvature)
        return root

    @property
    def _curvature(self) -> F64:
        curvature: F64 = self.singular_values**2 + self.prior
        return curvature

    def compute_known_covariance(self) -> F64:
        """(C, C) covariance of what is known alone, in the unknowns' own units."""
        return self._covariance(self.directions[:, self.is_known], self.is_known)

    def covariance(self, gauge: F64) -> F64:
        """(C, C) in the unknowns' own units; zero along *gauge* (C, k), which moves no point.

        What the readings do not know is as uncertain as a plausible departure, not certain.
        """
        without_gauge = self.directions - gauge @ (gauge.T @ self.directions)
        return self._covariance(without_gauge, np.ones_like(self.is_known))

    def _covariance(self, directions: F64, chosen: Mask) -> F64:
        root = directions / np.sqrt(self._curvature[chosen])
        root = self.scale[:, None] * root
        covariance: F64 = root @ root.T
        return covariance


def solve_with_prior(
    gram: F64, side: F64, scale: F64, drawn: F64, damping: float = 0.0, along_all: bool = False
) -> Solution:
    """What `LinearModel.solve_with_prior` says, from products (C, C) of the columns and (C,) with a
    residual; *scale* (C,): plausible departures."""
    values, vectors = np.linalg.eigh(gram * np.outer(scale, scale))
    curvature, directions = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    largest = float(curvature.max(initial=0.0))
    is_known = curvature > max(LEAST_KNOWN**2, ROUNDING * largest)
    prior = ~is_known | along_all
    slope = directions.T @ (scale * side) + prior * (directions.T @ (drawn / scale))
    leaned = curvature + prior
    step = scale * (directions @ (slope / (leaned + damping * largest)))
    gain = float(np.sum(slope**2 / leaned))
    return Solution(step, np.sqrt(curvature), is_known, prior, directions, scale, gain)

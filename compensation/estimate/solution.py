"""One linear least-squares problem solved by singular values: what is known, and how well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, Mask

#: A singular value below this, relative to the largest, is rounding.
ROUNDING = 1e-9
#: A direction known worse than a tenth of its plausible departure is not known.
LEAST_KNOWN = 10.0


@dataclass(frozen=True)
class Solution:
    """One linear least-squares solution by singular values, in scaled unknowns."""

    step: F64  # (C,) in the unknowns' own units
    singular_values: F64  # (C,)
    known: Mask  # (C,) which directions are known
    prior: Mask  # (C,) along which the drawing counts as one more reading
    directions: F64  # (C, C) columns: directions in scaled unknowns
    scale: F64  # (C,) plausible departures
    gain: float  # by how much the sum of squares falls, to first order

    @property
    def rank(self) -> int:
        return int(self.known.sum())

    @property
    def null(self) -> F64:
        """(C, C − rank) directions the readings do not know, in plausible departures."""
        return self.directions[:, ~self.known]

    @property
    def told(self) -> float:
        """How many unknowns the readings told, by the share they had in each beside the drawing."""
        curvature = self.singular_values**2
        told = curvature[curvature > 0] / (curvature + self.prior)[curvature > 0]
        return float(told.sum())

    def off_drawing(self, departure: F64) -> float:
        """What a *departure* (C,) from the drawing costs along directions that lean on it."""
        along = self.directions[:, self.prior].T @ (departure / self.scale)
        return float(along @ along)

    @property
    def known_step(self) -> F64:
        """(C,) the step along what is known, nothing beside it."""
        known = self.directions[:, self.known]
        step: F64 = self.scale * (known @ (known.T @ (self.step / self.scale)))
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

    def known_covariance(self) -> F64:
        """(C, C) covariance of what is known alone, in the unknowns' own units."""
        return self._covariance(self.directions[:, self.known], self.known)

    def covariance(self, gauge: F64) -> F64:
        """(C, C) in the unknowns' own units; zero along *gauge* (C, k), which moves no point.

        What the readings do not know is as uncertain as a plausible departure, not certain.
        """
        clear = self.directions - gauge @ (gauge.T @ self.directions)
        return self._covariance(clear, np.ones_like(self.known))

    def _covariance(self, directions: F64, chosen: Mask) -> F64:
        root = directions / np.sqrt(self._curvature[chosen])
        root = self.scale[:, None] * root
        covariance: F64 = root @ root.T
        return covariance


def solve(
    triangle: F64, scale: F64, pull: F64, damping: float = 0.0, held: bool = False
) -> Solution:
    """Minimise |A δ + r| from the triangular factor (·, C+1) of [A·scale, r].

    Along directions that the readings do not know, δ near *pull* (C,), where the drawing lies,
    counts as one more reading, good to a plausible departure; *held*: along all. *damping* is
    relative to the largest singular value squared.
    """
    c = len(scale)
    square = np.zeros((c, c + 1))
    square[: min(c, len(triangle))] = triangle[:c]
    u, s, vt = np.linalg.svd(square[:, :c])
    largest = s[0] if c else 0.0
    s = np.where(s > ROUNDING * largest, s, 0.0)
    known = s > LEAST_KNOWN
    prior = ~known | held
    slope = s * (u.T @ square[:, c]) - prior * (vt @ (pull / scale))
    curvature = s**2 + prior
    step = -slope / (curvature + damping * largest**2)
    gain = float(np.sum(slope**2 / curvature))
    return Solution(scale * (vt.T @ step), s, known, prior, vt.T, scale, gain)

"""One linear least-squares problem solved by singular values: what is known, and how well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]

#: A singular value below this, relative to the largest, is rounding.
ROUNDING = 1e-9
#: A direction known worse than a tenth of its plausible departure is not known.
LEAST_KNOWN = 10.0


@dataclass(frozen=True)
class Solution:
    """One linear least-squares solution by singular values, in scaled unknowns."""

    step: F64  # (C,) in the unknowns' own units
    singular_values: F64  # (C,)
    known: npt.NDArray[np.bool_]  # (C,) which directions are known
    directions: F64  # (C, C) columns: directions in scaled unknowns
    scale: F64  # (C,) plausible departures
    gain: float  # by how much the sum of squares falls, to first order

    @property
    def rank(self) -> int:
        return int(self.known.sum())

    @property
    def null(self) -> F64:
        """(C, C − rank) directions the readings say nothing about, in plausible departures."""
        return self.directions[:, ~self.known]

    def covariance(self) -> F64:
        """(C, C) covariance of what is known, in the unknowns' own units."""
        root = self.scale[:, None] * self.directions[:, self.known]
        root = root / self.singular_values[self.known]
        covariance: F64 = root @ root.T
        return covariance


def solve(
    triangle: F64, scale: F64, pull: F64, damping: float = 0.0, held: bool = False
) -> Solution:
    """Minimise |A δ + r| from the triangular factor (·, C+1) of [A·scale, r].

    Along directions the readings say nothing about, δ is *pull* (C,); along those they hardly
    know, 0. *held*: δ near *pull* counts as one more reading, and all are known. *damping* is
    relative to the largest singular value squared.
    """
    c = len(scale)
    square = np.zeros((c, c + 1))
    square[: min(c, len(triangle))] = triangle[:c]
    u, s, vt = np.linalg.svd(square[:, :c])
    largest = s[0] if c else 0.0
    touched = s > ROUNDING * largest
    known = touched & (held | (s > LEAST_KNOWN))
    wanted = vt @ (pull / scale)
    slope = s * (u.T @ square[:, c]) - held * wanted
    curvature = s**2 + held
    step = np.where(touched, 0.0, wanted)
    step[known] = (-slope / (curvature + damping * largest**2 + ~known))[known]
    gain = float(np.sum(slope[known] ** 2 / curvature[known]))
    return Solution(scale * (vt.T @ step), s, known, vt.T, scale, gain)

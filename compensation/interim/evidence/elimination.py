"""Elimination of known errors from sums over checks, for all sizes of the standing errors at once.

With curvature K of the q known errors by the checks, and D the inverse of their prior variances,

    (K + D(s))⁻¹ = Tᵀ diag(w(s)) T

by one T for all sizes s of the standing errors. The other errors are eliminated first (Cholesky).
What remains of the standing errors is taken in its eigenvectors, in which a prior of any size stays
diagonal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, eigh, solve_triangular

from armd.arrays import F64


@dataclass(frozen=True)
class CheckSums:
    """Sums over some checks of the products of their q known errors and their numbers."""

    curvature: F64  # (q, q)
    side: F64  # (q,)
    square: float
    numbers: int

    def subtract_check(self, error_columns: F64, residual: F64) -> CheckSums:
        """Return the sums without a check of these *error_columns* (r, q) and this
        *residual* (r,).
        """
        return CheckSums(
            self.curvature - error_columns.T @ error_columns,
            self.side - error_columns.T @ residual,
            self.square - float(residual @ residual),
            self.numbers - len(residual),
        )


@dataclass(frozen=True)
class EliminatedErrors:
    """Sums over some checks with the q known errors eliminated, for S sizes of the
    standing errors.
    """

    rotation: F64  # (q, q) T
    weights: F64  # (S, q) w
    side: F64  # (q,) the known errors' side, rotated
    spread: F64  # (S,) half the log determinant of the readings' covariance
    square: F64  # (S,) remainder of the readings' squared norm


def eliminate_standing(
    curvature: F64, side: F64, square: float, standing: slice, scales: tuple[float, ...]
) -> EliminatedErrors:
    """Eliminate all errors from *curvature* (q, q), *side* (q,) and *square*.

    The *standing* errors are multiplied by each of *scales*; all others have a prior variance of 1.
    """
    q = len(side)
    stands = np.zeros(q, dtype=bool)
    stands[standing] = True
    fixed, free = np.flatnonzero(~stands), np.flatnonzero(stands)
    gram = curvature[np.ix_(fixed, fixed)] + np.eye(len(fixed))
    factor = cholesky(gram, lower=True, check_finite=False)
    inverse = solve_triangular(factor, np.eye(len(fixed)), lower=True, check_finite=False)
    across = inverse @ curvature[np.ix_(fixed, free)]
    remainder = curvature[np.ix_(free, free)] - across.T @ across
    value, vector = eigh(remainder, check_finite=False, driver="evd") if len(free) else _NOTHING
    value = np.maximum(value, 0.0)
    rotation = np.zeros((q, q))
    rotation[np.ix_(fixed, fixed)] = inverse
    rotation[np.ix_(free, fixed)] = -vector.T @ across.T @ inverse
    rotation[np.ix_(free, free)] = vector.T
    by = np.array(scales)[:, None] ** 2
    weights = np.ones((len(scales), q))
    weights[:, free] = by / (1.0 + by * value)
    turned = rotation @ side
    return EliminatedErrors(
        rotation,
        weights,
        turned,
        np.log(np.diag(factor)).sum() + 0.5 * np.log1p(by * value).sum(axis=1),
        square - weights @ turned**2,
    )


_NOTHING: tuple[F64, F64] = (np.zeros(0), np.zeros((0, 0)))

"""Measures of how well poses determine the constants: singular values, ranks, indices O1 to O5.

Y. Sun and J. M. Hollerbach, Observability index selection for robot calibration, ICRA 2008, give
the five indices of an identification Jacobian with singular values σ₁ ≥ … ≥ σ_m and n poses: O1 =
(σ₁ … σ_m)^(1/m) / √n, O2 = σ_m / σ₁, O3 = σ_m, O4 = σ_m² / σ₁, O5 = 1 / (1/σ₁ + … + 1/σ_m).

Columns are scaled by `PLAUSIBLE` departures (10 mm, 0.02 rad), as in `armd calibrate`, so that σ is
in mm. Placements and seats are eliminated first. The m directions are those that move a point at
all: the structural rank.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.estimate.gauge import ROUNDING, list_free_constants
from armd.compensation.estimate.placements.poses import make_rigid_columns
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.fit import GAUGE_POSTURES
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_jacobian


@dataclass(frozen=True)
class ReadingColumns:
    """Rows of the linear problem around the nominal model; k nuisances, C scaled constants."""

    constants: F64  # (n, r, C) mm per plausible departure
    nuisances: F64  # (n, r, k)
    tip_mm: F64  # (n, 3)

    def rows(self, chosen: I64) -> ReadingColumns:
        """Return the *chosen* readings."""
        return ReadingColumns(self.constants[chosen], self.nuisances[chosen], self.tip_mm[chosen])


def compute_constant_columns(arm: Arm, q: F64, parameters: F64) -> tuple[F64, F64]:
    """Compute tips (n, 3) mm and the columns (n, 3, C) of the constants.

    The constants are those that `armd calibrate` identifies, in mm per plausible departure.
    """
    tip, derivatives = compute_jacobian(q, parameters)
    unknowns = Unknowns(list_free_constants(arm))
    no_terms = np.zeros((len(q), 0))
    scale = unknowns.get_plausible([], no_terms)
    return tip, unknowns.columns(derivatives, no_terms, []) * scale


def compute_tracker_columns(arm: Arm, q: F64, parameters: F64) -> ReadingColumns:
    """Compute the columns of a tracker's points, with one unknown pose of its frame."""
    tip, constants = compute_constant_columns(arm, q, parameters)
    return ReadingColumns(constants, make_rigid_columns(tip - tip.mean(axis=0)), tip)


def eliminate_nuisances(columns: ReadingColumns, fixed: F64 | None = None) -> tuple[F64, F64]:
    """Return orthonormal nuisances (m, k'), and the constants' columns (m, C) orthogonal to them.

    *fixed* (D, k): rows of the nuisances alone, such as certified lengths; they are the last of m =
    n · r + D.
    """
    k, c = columns.nuisances.shape[2], columns.constants.shape[2]
    nuisances, constants = columns.nuisances.reshape(-1, k), columns.constants.reshape(-1, c)
    if fixed is not None:
        nuisances = np.vstack([nuisances, fixed])
        constants = np.vstack([constants, np.zeros((len(fixed), c))])
    basis = _orthonormal(nuisances)
    free_columns = constants - basis @ (basis.T @ constants)
    return basis, free_columns - basis @ (basis.T @ free_columns)  # twice: removes rounding


def factorise_constants(columns: ReadingColumns, fixed: F64 | None = None) -> tuple[F64, F64]:
    """Compute singular values (C,), descending, and directions (C, C) as columns.

    Nuisances are eliminated.
    """
    free_columns = eliminate_nuisances(columns, fixed)[1]
    _, s, vt = np.linalg.svd(np.linalg.qr(free_columns, mode="r"), full_matrices=True)
    return np.concatenate([s, np.zeros(len(vt) - len(s))]), vt.T


def _orthonormal(columns: F64) -> F64:
    """Return an orthonormal basis (m, rank) of columns (m, k), without directions that are
    rounding.
    """
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    basis: F64 = u[:, s > ROUNDING * s.max(initial=0.0)]
    return basis


def count_directions(singular_values: F64) -> int:
    """Count the singular values that are more than rounding errors."""
    return int((singular_values > ROUNDING * singular_values.max(initial=0.0)).sum())


def compute_structural_rank(arm: Arm, parameters: F64, seed: int = 0) -> int:
    """Count the combinations of the constants that points over all joints' turns determine.

    For a chain without parallel axes it is 4 N − 3: four constants a joint and three of the tip,
    less two that move the whole arm about its first axis and four that the last joint shares with
    the tip. For parallel axes, β replaces d (`list_free_constants`), so they alone do not reduce
    it; special geometry can.
    """
    q = np.random.default_rng(seed).uniform(-np.pi, np.pi, (GAUGE_POSTURES, arm.n_joints))
    return count_directions(factorise_constants(compute_tracker_columns(arm, q, parameters))[0])


def compute_observability_indices(singular_values: F64, poses: int) -> dict[str, float]:
    """Compute O1 to O5 of singular values (m,), descending, in n *poses*.

    All are 0 if the smallest is 0.
    """
    s = np.asarray(singular_values, dtype=float)
    largest, smallest = float(s[0]), float(s[-1])
    if smallest <= 0.0:
        return dict.fromkeys(("O1", "O2", "O3", "O4", "O5"), 0.0)
    return {
        "O1": float(np.exp(np.log(s).mean()) / np.sqrt(poses)),
        "O2": smallest / largest,
        "O3": smallest,
        "O4": smallest**2 / largest,
        "O5": float(1.0 / (1.0 / s).sum()),
    }

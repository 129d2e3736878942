"""An identified arm beside the simulator's own, along what is known of it."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.estimate.placements.poses import make_rigid_columns
from armd.compensation.identify.result import Result
from armd.compensation.model.kinematics import compute_jacobian
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.effects.effect import Conditions


def errors_of(found: Result, true: TrueArm) -> F64:
    """What is known of the arm minus what is true, in units of the stated uncertainties, along
    directions that are independent of each other.

    Unknowns that place the arm, or move no point, are nobody's: over postures all over the turn,
    the change of the unknowns is looked for that brings the arm found onto the true one, a rigid
    motion of its base aside.
    """
    fit = found.fit
    low, high = nominal.get_limits_rad()
    q = np.random.default_rng(5).uniform(low, high, (1500, 6))
    wanted = true.tip(q, Conditions.at_rest(len(q), 6))
    position, columns = compute_jacobian(q, np.tile(fit.constants, (len(q), 1)))
    scale = fit.solution.scale
    own = fit.unknowns.columns(columns, np.zeros((len(q), 0)), []) * scale
    both = np.concatenate([own, make_rigid_columns(position)], axis=2).reshape(3 * len(q), -1)
    change = np.linalg.lstsq(both, (wanted - position).ravel(), rcond=1e-10)[0][: len(scale)]
    known = fit.solution.directions[:, fit.solution.is_known]
    covariance = known.T @ (fit.covariance / np.outer(scale, scale)) @ known
    normalised: F64 = np.linalg.solve(np.linalg.cholesky(covariance), -known.T @ change)
    return normalised

"""The corrected pose of the tip as a function of the joint angles, with all else given."""

from __future__ import annotations

import dataclasses

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.kinematics import compute_motion_directions, compute_pose
from armd.compensation.model.slow_factors import SlowFactor
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term


class CorrectedPose:
    """The corrected pose at n instants; factors of temperature and time are computed once.

    In rows of *moving* (n,) the approach is the direction in which the tip moves at the given joint
    rates, so it turns with the posture.
    """

    def __init__(
        self,
        arm: Arm,
        calibration: Calibration | None,
        states: States,
        moving: Mask | None = None,
    ) -> None:
        self._arm = arm
        self.measured = states
        self._moving = np.zeros(states.n, bool) if moving is None else moving
        self.constants = arm.nominal() if calibration is None else calibration.vector(arm.n_joints)
        self._reference_c = (
            arm.reference_temperature_c
            if calibration is None
            else calibration.reference_temperature_c
        )
        self._terms = [] if calibration is None else calibration.terms
        slow = [_part(term, of_pose=False) for term in self._terms]
        self._slow = self._values(slow, states)
        self._pose_terms = [_part(term, of_pose=True) for term in self._terms]

    def tip_pose(self, q: F64, rows: I64 | slice = slice(None)) -> tuple[F64, F64]:
        """Compute position (m, 3) mm and rotation (m, 3, 3) at angles (m, N) rad of the chosen
        rows.

        NaN where a temperature or time that a term uses is missing.
        """
        if not self._terms:
            return compute_pose(q, self.constants)
        states = self.states(q, rows)
        values = self._slow[rows] * self._values(self._pose_terms, states)
        return compute_pose(q, compute_parameter_rows(self.constants, self._terms, values))

    def states(self, q: F64, rows: I64 | slice = slice(None)) -> States:
        """Return the states of the chosen rows with these angles (m, N) rad."""
        states = dataclasses.replace(self.measured.rows(rows), q=q)
        moving = self._moving[rows]
        if not moving.any():
            return states
        approach = states.approach.copy()
        approach[moving] = compute_motion_directions(
            q[moving], states.rate[moving], self._arm.nominal()
        )
        return dataclasses.replace(states, approach=approach)

    def _values(self, terms: list[Term], states: States) -> F64:
        return compute_basis_values(terms, states, self._arm, self._reference_c, self.constants)


def _part(term: Term, *, of_pose: bool) -> Term:
    """Return the term with only its pose factors, or with only the others."""
    factors = [f for f in term.basis if isinstance(f, SlowFactor) != of_pose]
    return term.model_copy(update={"basis": factors})

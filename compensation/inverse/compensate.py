"""Find joint angles that bring the corrected tip, with terms and temperature, to a position.

With six joints or more the tip keeps the orientation that the nominal arm has at the given angles.
With fewer joints, and with more than needed, the angles change least.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.inverse.corrected_pose import CorrectedPose
from armd.compensation.inverse.nearest import (
    compute_derivatives,
    compute_inverse_condition,
    solve_nearest,
)
from armd.compensation.kernel.model import Model
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.state import States

#: A row is reached if its tip and orientation are nearer than this.
REACHED_MM, REACHED_RAD = 5e-7, 5e-10
#: The joints needed to hold an orientation besides a position.
FOR_ORIENTATION = 6
#: The tip's motion is scaled in radians and shares of the reach. Near a singularity, its least
#: singular value is below this share of the largest.
SINGULAR = 1e-4
#: Rows that are solved together.
PIECE = 4096
OK, UNREACHABLE, SINGULARITY = "ok", "unreachable", "singular"


@dataclass(frozen=True)
class CommandedAngles:
    """The angles to command, row by row."""

    q: F64  # (n, N) rad; NaN where the status is not "ok"
    change_mm: F64  # (n,) distance of the tip from its target at the given angles
    residual_mm: F64  # (n,) distance at the angles found
    status: list[str]  # "ok", "unreachable", "singular", "limit joint k"

    @property
    def is_ok(self) -> Mask:
        """A mask (n,) of the rows with status "ok"."""
        return np.array([status == OK for status in self.status], dtype=bool)


def compensate(
    arm: Arm,
    calibration: LoadedCalibration | None,
    states: States,
    wanted_mm: F64 | None = None,
    moving: Mask | None = None,
) -> CommandedAngles:
    """Compute commands for the given *states*, whose angles are a nominal solution.

    *wanted_mm* (n, 3) in the base frame. For NaN rows, or all without it, the target is the nominal
    arm's tip at these angles. *moving* (n,): see `CorrectedPose`. Lags are followed within each
    series of *states*.
    """
    nominal_mm, nominal_turn = compute_pose(states.q, arm.nominal())
    target_mm = nominal_mm
    if wanted_mm is not None:
        target_mm = np.where(np.isnan(wanted_mm), nominal_mm, wanted_mm)
    pose = CorrectedPose(arm, calibration.content if calibration else None, states, moving)
    problem = _PoseProblem(arm, pose, target_mm, nominal_turn)
    q, share = np.empty_like(states.q), np.empty(states.n)
    for first in range(0, states.n, PIECE):
        rows = np.arange(first, min(first + PIECE, states.n))
        q[rows], share[rows] = problem.solve(states.q[rows], rows)
    model = Model(arm, calibration)
    before = model.correct_states(pose.states(states.q))[0]
    after = model.correct_states(pose.states(q))[0]
    change_mm, residual_mm = (np.linalg.norm(tip - target_mm, axis=1) for tip in (before, after))
    turned = problem.turned_rad(q)
    status = _status(arm, q, (residual_mm <= REACHED_MM) & (turned <= REACHED_RAD), share)
    commands = CommandedAngles(q, change_mm, residual_mm, status)
    q[~commands.is_ok] = np.nan
    return commands


def _status(arm: Arm, q: F64, reached: Mask, share: F64) -> list[str]:
    low, high = arm.limits_rad
    beyond = (q < low) | (q > high)
    statuses = []
    for row in range(len(q)):
        if not reached[row]:
            statuses.append(UNREACHABLE)
        elif share[row] < SINGULAR:
            statuses.append(SINGULARITY)
        elif beyond[row].any():
            statuses.append(f"limit joint {int(np.argmax(beyond[row])) + 1}")
        else:
            statuses.append(OK)
    return statuses


class _PoseProblem:
    """The constraints that the angles of each row must meet."""

    def __init__(self, arm: Arm, pose: CorrectedPose, wanted_mm: F64, turn: F64) -> None:
        self._pose = pose
        self._nominal = CorrectedPose(arm, None, pose.measured)
        self._wanted_mm = wanted_mm
        self._turn = turn
        self._oriented = arm.n_joints >= FOR_ORIENTATION
        self._reach_mm = max(arm.reach_mm, 1.0)

    def solve(self, q0: F64, rows: I64) -> tuple[F64, F64]:
        """Solve for angles (m, N); also return the distance (m,) from a singularity.

        The latter is the smaller one of the corrected arm at the solution and the nominal arm at
        the given angles.
        """

        def constraints(q: F64, chosen: I64) -> F64:
            return self.miss(self._pose, q, rows[chosen])

        def nominal(q: F64, chosen: I64) -> F64:
            return self.miss(self._nominal, q, rows[chosen])

        q, _ = solve_nearest(constraints, q0)
        every = np.arange(len(rows))
        corrected = compute_derivatives(constraints, q, every)
        nominal_slopes = compute_derivatives(nominal, q0, every)
        return q, np.minimum(
            compute_inverse_condition(corrected), compute_inverse_condition(nominal_slopes)
        )

    def miss(self, pose: CorrectedPose, q: F64, rows: I64) -> F64:
        """Return the miss (m, 3) of the position in shares of the reach, then of the rotation in
        rad.

        The rotation (m, 3) follows only with `FOR_ORIENTATION` joints or more.
        """
        position, turn = pose.tip_pose(q, rows)
        miss = (position - self._wanted_mm[rows]) / self._reach_mm
        if not self._oriented:
            return miss
        return np.hstack([miss, compute_rotation_vectors(turn, self._turn[rows])])

    def turned_rad(self, q: F64) -> F64:
        """Return the error (n,) of the orientation; 0 where it is free."""
        if not self._oriented:
            return np.zeros(len(q))
        vectors = compute_rotation_vectors(self._pose.tip_pose(q)[1], self._turn)
        angle: F64 = np.linalg.norm(vectors, axis=1)
        return angle


def compute_rotation_vectors(turn: F64, target: F64) -> F64:
    """Compute rotation vectors (n, 3), rad, in the base frame.

    They lead from *target* rotations (n, 3, 3) to *turn* (n, 3, 3).
    """
    difference = np.einsum("nij,nkj->nik", turn, target)
    sine = 0.5 * np.stack(
        [
            difference[:, 2, 1] - difference[:, 1, 2],
            difference[:, 0, 2] - difference[:, 2, 0],
            difference[:, 1, 0] - difference[:, 0, 1],
        ],
        axis=1,
    )
    cosine = 0.5 * (np.trace(difference, axis1=1, axis2=2) - 1.0)
    length = np.linalg.norm(sine, axis=1)
    angle = np.arctan2(length, cosine)
    scale = np.where(length > 1e-9, angle / np.maximum(length, 1e-9), 1.0)
    vectors: F64 = sine * scale[:, None]
    return vectors

"""Find postures that bring the tip to a target."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64, Mask
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_jacobian

ITERATIONS = 25
#: A posture reaches its target when the tip comes this near.
REACHED_MM = 0.5
#: The longest step of a joint, and the damping of steps.
STEP_RAD, DAMPING_MM = 0.4, 3.0


def solve_postures(arm: Arm, constants: F64, target_mm: F64, q: F64) -> tuple[F64, Mask]:
    """Turn postures *q* (m, N) towards targets (3,) or (m, 3) mm by damped least squares.

    Returns the postures, and which of them (m,) reach the target within the limits.
    """
    low, high = arm.range_rad
    for _ in range(ITERATIONS):
        tip, derivatives = compute_jacobian(q, constants)
        columns = derivatives[:, :, arm.layout.angles]
        missing = (target_mm - tip)[:, :, None]
        squared = columns @ columns.transpose(0, 2, 1) + DAMPING_MM**2 * np.eye(3)
        step = (columns.transpose(0, 2, 1) @ np.linalg.solve(squared, missing))[:, :, 0]
        q = q + np.clip(step, -STEP_RAD, STEP_RAD)
    missed = np.linalg.norm(compute_jacobian(q, constants)[0] - target_mm, axis=1)
    inside = ((q >= low) & (q <= high)).all(axis=1)
    return q, inside & (missed < REACHED_MM)

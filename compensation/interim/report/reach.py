"""The displacement of the tip by a change, over the arm's whole reach."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.design.clearance import make_resting_states
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.placements.poses import make_rigid_columns
from armd.compensation.interim.checks.signals import Signals
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.state import States

POSES = 400


def draw_poses(arm: Arm, reference_c: float, count: int, seed: int) -> States:
    """Draw random poses over the ranges of all joints, each joint coming to rest from
    either side.
    """
    rng = np.random.default_rng(seed)
    q = rng.uniform(*arm.range_rad, (count, arm.n_joints))
    return make_resting_states(q, rng, arm, reference_c, 0.0)


def compute_tip_rms_um(
    arm: Arm, calibration: Calibration, candidate: Candidate, values: F64
) -> float:
    """Compute the RMS over the arm's reach of a change of *values* (p,), without its
    rigid motion.
    """
    states = draw_poses(arm, calibration.reference_temperature_c, POSES, 20)
    signals = Signals(states, arm, calibration)
    moved = (signals.compute_motions(candidate.columns) @ values).reshape(-1)
    rigid = make_rigid_columns(signals.position_mm - signals.position_mm.mean(axis=0)).reshape(
        -1, 6
    )
    residual_mm = moved - rigid @ np.linalg.lstsq(rigid, moved, rcond=None)[0]
    return 1e3 * float(np.sqrt((residual_mm**2).sum() / states.n))

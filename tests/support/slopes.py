"""How residuals move with small steps of poses and targets: truth for a linearisation's columns."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armd.arrays import F64
from armd.compensation.estimate.linearise import Linearisation
from armd.compensation.estimate.placements.poses import Poses

Residual = Callable[[Poses], F64]


def compute_pose_slopes(at: Linearisation, residual: Residual, step: float) -> F64:
    """Central differences (n, …, 6) by the twists of all placements at once."""
    return _differ(at, residual, step, 6)


def compute_target_slopes(at: Linearisation, residual: Residual, step: float) -> F64:
    """Central differences (n, …, 3) by the shifts of all targets at once."""
    return _differ(at, residual, step, 3)


def _differ(at: Linearisation, residual: Residual, step: float, axes: int) -> F64:
    slopes = []
    for way in step * np.eye(axes):
        twist, shift = np.zeros((len(at.centre_mm), 6)), np.zeros_like(at.poses.target_mm)
        (twist if axes == 6 else shift)[:] = way
        there = [at.poses.moved(at.centre_mm, sign * twist, sign * shift) for sign in (1.0, -1.0)]
        slopes.append((residual(there[0]) - residual(there[1])) / (2.0 * step))
    return np.stack(slopes, axis=-1)

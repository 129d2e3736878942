"""Where an arm's parts are: clear of the table and of its own column."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import frames, jacobian


def height_mm(q: F64, constants: F64, arm: Arm) -> F64:
    """(n,) height over the base, against gravity, of the lowest of all joints and the tip."""
    up = -np.array(arm.gravity) / np.linalg.norm(arm.gravity)
    origins = frames(q, constants)[0]
    tip = jacobian(q, constants)[0]
    points = np.concatenate([origins - origins[:, :1], (tip - origins[:, 0])[:, None]], axis=1)
    height: F64 = (points @ up).min(axis=1)
    return height


def from_the_column_mm(q: F64, constants: F64) -> F64:
    """(n,) distance of the tip from the base's first axis."""
    distance: F64 = np.hypot(*jacobian(q, constants)[0][:, :2].T)
    return distance

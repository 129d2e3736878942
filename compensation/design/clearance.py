"""Clearance of poses from the table and from the arm's own column, and poses at rest."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_frames, compute_jacobian
from armd.compensation.model.state import States

RATE_RAD_S = 0.05  # of a joint that comes to rest


def compute_height_mm(q: F64, constants: F64, arm: Arm) -> F64:
    """Compute the height (n,) over the base, against gravity, of the lowest joint or the tip."""
    up = -np.array(arm.gravity) / np.linalg.norm(arm.gravity)
    origins = compute_frames(q, constants)[0]
    tip = compute_jacobian(q, constants)[0]
    points = np.concatenate([origins - origins[:, :1], (tip - origins[:, 0])[:, None]], axis=1)
    height: F64 = (points @ up).min(axis=1)
    return height


def make_resting_states(
    q: F64, rng: np.random.Generator, arm: Arm, celsius: float, time_s: float
) -> States:
    """Make states of readings at angles (n, N), all sensors at one temperature.

    Each joint comes to rest from a random side, with a random direction of approach.
    """
    n = len(q)
    approach = rng.normal(size=(n, 3))
    return States(
        q=q,
        rate=RATE_RAD_S * rng.choice([-1.0, 1.0], q.shape),
        temperature_c=np.full((n, len(arm.sensors)), celsius),
        time_s=np.full(n, time_s),
        approach=approach / np.linalg.norm(approach, axis=1, keepdims=True),
        series=np.arange(n),
    )


def compute_column_distance_mm(q: F64, constants: F64) -> F64:
    """Compute the distance (n,) of the tip from the base's first axis."""
    distance: F64 = np.hypot(*compute_jacobian(q, constants)[0][:, :2].T)
    return distance

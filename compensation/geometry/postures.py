"""Random postures within an arm's limits, in a state of which only the temperature is known."""

from __future__ import annotations

import datetime

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.state import States

#: rad/s: so slow that only its sign, the side of approach, has an effect.
CREEP_RAD_S = 1e-12


def draw_postures(arm: Arm, n: int, seed: int) -> F64:
    """Draw angles (n, N) rad, uniform within the limits; without limits half a turn either way."""
    low, high = arm.range_rad
    drawn: F64 = np.random.default_rng(seed).uniform(low, high, (n, arm.n_joints))
    return drawn


def make_states(q: F64, arm: Arm, celsius: float, calibration: Calibration, seed: int) -> States:
    """Make states of postures *q* (n, N) at rest, all sensors at one temperature.

    The time is when the calibration was made; sides and directions of approach are random.
    """
    rng = np.random.default_rng(seed)
    n = len(q)
    approach = rng.normal(size=(n, 3))
    created = datetime.datetime.fromisoformat(calibration.created)
    created = created.replace(tzinfo=created.tzinfo or datetime.UTC)
    return States(
        q=q,
        rate=CREEP_RAD_S * rng.choice([-1.0, 1.0], q.shape),
        temperature_c=np.full((n, len(arm.sensors)), celsius),
        time_s=np.full(n, created.timestamp()),
        approach=approach / np.linalg.norm(approach, axis=1, keepdims=True),
        series=np.arange(n),
    )

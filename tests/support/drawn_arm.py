"""An arm with a random drawing, two sensors, and gravity aslant."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from armd.compensation.model.arm import Arm


def draw_arm(
    n_joints: int,
    rng: np.random.Generator,
    serial_number: str,
    more: Callable[[int], dict[str, Any]] = lambda k: {},
) -> Arm:
    """*more* gives further keys of joint k, from 0."""
    joints = [
        {
            "d_mm": float(rng.uniform(0, 300)),
            "a_mm": float(rng.uniform(0, 300)),
            "alpha_deg": float(rng.choice([-90, 0, 90])),
            "theta_deg": float(rng.uniform(-20, 20)),
            **more(k),
        }
        for k in range(n_joints)
    ]
    return Arm.model_validate(
        {
            "schema": "armd.arm/1",
            "serial_number": serial_number,
            "gravity": [0.0, 0.6, -0.8],
            "temperature_sensor": [{"name": "t1"}, {"name": "t2"}],
            "joint": joints,
            "tip": {"offset_mm": [10.0, 20.0, 150.0]},
        }
    )

"""A small arm, and a calibration that differs from its nominal geometry, as plain data."""

from __future__ import annotations

import json
from typing import Any

from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import name_constants
from support.drawn import drawn

JOINT = {"a_mm": 300.0, "counts_per_turn": 1 << 20, "min_deg": -170.0, "max_deg": 170.0}
ARM: dict[str, Any] = {
    "schema": "armd.arm/1",
    "serial_number": "SMALL-1",
    "joint": [
        JOINT | {"alpha_deg": 90.0, "d_mm": 200.0, "theta_deg": 10.0},
        JOINT | {"beta_deg": 2.0, "direction": -1},
        JOINT | {"alpha_deg": -90.0, "a_mm": 0.0},
    ],
    "tip": {"offset_mm": [50.0, 3.0, 100.0], "radius_mm": 1.0},
}


def _calibration() -> dict[str, Any]:
    arm = Arm.model_validate_json(json.dumps(ARM))
    constants = name_constants(arm.nominal(), arm.n_joints)
    for k, name in enumerate(constants):
        constants[name] += (
            0.01 * (k + 1) if name.startswith(("theta", "alpha", "beta", "d", "a")) else 0.001
        )
    calibration = drawn(arm, constants=constants)
    data: dict[str, Any] = json.loads(calibration.model_dump_json(by_alias=True))
    return data


CALIBRATION = _calibration()

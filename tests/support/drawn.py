"""A calibration that has identified nothing: the drawing, and what a test changes in it."""

from __future__ import annotations

from typing import Any

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration, name_constants


def drawn(
    arm: Arm, d_1_mm: float = 0.0, /, *, values: F64 | None = None, **more: Any
) -> Calibration:
    """The drawing's constants, or *values* (C,), the first link *d_1_mm* longer, and *more* keys
    of the file, as it or the model has them."""
    constants = name_constants(arm.nominal() if values is None else values, arm.n_joints)
    constants["d_1"] += d_1_mm
    content = {
        "arm": arm.serial_number, "created": "2026-01-01T00:00:00+00:00",
        "reference_temperature_c": 20.0, "constants": constants,
    }  # fmt: skip
    return Calibration.model_validate(content | more)

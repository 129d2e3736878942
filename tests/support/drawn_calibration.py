"""A drawn arm and a calibration of it with the terms that a test asks for."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import LoadedCalibration
from support.drawn import drawn
from support.drawn_arm import draw_arm

REFERENCE_C = 20.0
WARM = {"kind": "temperature", "weights": {"t1": 0.4, "t2": 0.6}}


def an_arm(n_joints: int) -> Arm:
    return draw_arm(n_joints, np.random.default_rng(n_joints), "TEST")


def calibrated(arm: Arm, terms: list[dict[str, object]], **more: object) -> LoadedCalibration:
    rng = np.random.default_rng(8)
    constants = arm.nominal() + rng.normal(0, 1e-3, arm.layout.count)
    content = drawn(arm, values=constants, reference_temperature_c=REFERENCE_C, terms=terms, **more)
    return LoadedCalibration(content, "00" * 32, Path("calibration.json"))


def term(parameter: str, *basis: dict[str, object], coefficient: float = 1e-4) -> dict[str, object]:
    return {"parameter": parameter, "basis": list(basis), "coefficient": coefficient}

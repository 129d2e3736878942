"""A link of known expansion becomes longer by α·L·ΔT, and the file says nothing was measured."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armd import POINT
from armd.compensation.kernel.model import Model
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import load_calibration, save_calibration
from armd.compensation.model.known_expansion import known_expansion

ARM = Arm.model_validate(
    {
        "schema": "armd.arm/1",
        "serial_number": "TEST",
        "temperature_sensor": [{"name": "t1"}, {"name": "t2"}],
        "joint": [
            {"d_mm": 500.0, "temperature": "t1", "counts_per_turn": 1 << 20},
            {"a_mm": 400.0, "temperature": {"t1": 0.5, "t2": 0.5}, "counts_per_turn": 1 << 20},
            {"a_mm": 300.0, "counts_per_turn": 1 << 20},
        ],
        "tip": {"offset_mm": [100.0, 0.0, 0.0]},
    }
)


def test_stretched_out_along_x(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    saved = save_calibration(path, known_expansion(ARM, [10e-6, 20e-6, 30e-6]))
    loaded = load_calibration(path, ARM)
    assert loaded.sha256 == saved.sha256
    model = Model(ARM, loaded)
    model.fold(np.array([30.0, 40.0]), 0.0)
    points = np.zeros(1, POINT)
    model.correct(np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)), points)
    # Joint 1: 500 mm upwards, 10 K; joint 2: 400 mm outwards, 15 K; joint 3 has no sensor.
    assert points["position_mm"][0] == pytest.approx([800 + 0.12, 0.0, 500 + 0.05], abs=1e-9)
    assert points["correction_mm"][0] == pytest.approx([0.12, 0.0, 0.05], abs=1e-6)
    deviation = np.sqrt(points["covariance_mm2"][0][[0, 5]])
    assert deviation == pytest.approx([0.012, 0.005], rel=1e-3)


def test_provenance_and_range() -> None:
    calibration = known_expansion(ARM, [1e-6] * 3, temperature_range_c=(15.0, 35.0))
    assert "nothing was measured" in calibration.provenance["method"]
    assert calibration.temperature_range_c == {"t1": (15.0, 35.0), "t2": (15.0, 35.0)}


def test_one_coefficient_per_link() -> None:
    with pytest.raises(ValueError, match="shorter"):
        known_expansion(ARM, [1e-6, 1e-6])

"""An arm.toml of three joints and three sensors, for tests without a simulator."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from armd.drivers.sample import Temperatures, sample_dtype
from armd.files.schema import validate
from support.drawn import drawn

COUNTS = 1 << 20


def small_arm(**changes: Any) -> Arm:
    """Joint 1 uses sensor a, joint 2 sensor b; sensor c is used by none."""
    joint = {"a_mm": 300.0, "counts_per_turn": COUNTS, "min_deg": -170.0, "max_deg": 170.0}
    data = {
        "schema": "armd.arm/1",
        "serial_number": "SMALL-1",
        "temperature_sensor": [{"name": name} for name in "abc"],
        "joint": [
            joint | {"alpha_deg": 90.0, "temperature": "a"},
            joint | {"temperature": "b", "direction": -1},
            joint,
        ],
        "tip": {"offset_mm": [50.0, 0.0, 0.0], "radius_mm": 1.0},
    }
    return validate("arm.toml", data | changes, Arm)


def thermal_calibration(arm: Arm, **changes: Any) -> LoadedCalibration:
    """Nominal geometry; link 2 grows by 10 µm/K of sensor b; identified from 15 to 30 °C."""
    term = Term(parameter="a_2", basis=[Temperature(weights={"b": 1.0})], coefficient=0.01)
    ranges = {"a": (15.0, 30.0), "b": (15.0, 30.0)}
    content = {"terms": [term], "temperature_range_c": ranges} | changes
    return LoadedCalibration(drawn(arm, **content), "0123456789abcdef" * 4, None)


def samples_of(angles_deg: np.ndarray, rate_hz: int = 1000, first_seq: int = 0) -> np.ndarray:
    """Samples of joint angles (n, 3) as encoders without noise send them."""
    n = len(angles_deg)
    samples = np.zeros(n, sample_dtype(3))
    samples["seq"] = first_seq + np.arange(n)
    samples["monotonic_ns"] = 10**9 + (first_seq + np.arange(n)) * (10**9 // rate_hz)
    samples["stamp_ns"] = 1_700_000_000 * 10**9 + samples["monotonic_ns"]
    direction = np.array([1, -1, 1])
    samples["count"] = np.round(np.radians(angles_deg) * direction / (2 * math.pi) * COUNTS)
    samples["clock_mapped"] = True
    return samples


def reading(celsius: list[float], at_s: float) -> Temperatures:
    """All channels at a time of the stream, which begins at 1 s."""
    at_ns = round((1 + at_s) * 1e9)
    return Temperatures(np.array(celsius), at_ns, at_ns, 1_700_000_000 * 10**9 + at_ns)

"""A measurement as a daemon publishes it, with figures that all differ."""

from __future__ import annotations

from typing import Any

MEASUREMENT: dict[str, Any] = {
    "trigger": "button", "seq": 7, "stamp_ns": 1_700_000_000_123_456_789, "monotonic_ns": 5,
    "position_mm": [1.5, -2.25, 3.0], "standard_deviation_mm": [0.001, 0.002, 0.003],
    "covariance_mm2": [1e-4, 0, 0, 4e-4, 0, 9e-4], "orientation": [0.0, 0.0, 0.0, 1.0],
    "angles_rad": [0.25, -1.5], "rates_rad_s": [0.0, 1e-3], "count": 12, "duration_s": 0.5,
    "flags": 512, "flag_names": ["AT_REST"], "buttons": 1, "calibration": "0123456789abcdef",
    "approach": [0.0, 0.6, -0.8], "tip": None, "temperatures_c": {"t1": 20.5, "t2": None},
}  # fmt: skip

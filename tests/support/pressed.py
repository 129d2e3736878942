"""A measurement as a daemon publishes it: a button pressed at rest, of an arm of three joints."""

from __future__ import annotations

from typing import Any

from armd import Flag


def pressed(number: int, **changes: Any) -> dict[str, Any]:
    """*number* seconds after the beginning, angles that differ from press to press."""
    return {
        "trigger": "button", "seq": 1000 * number,
        "stamp_ns": 1_800_000_000_250_000_000 + number * 10**9,
        "count": 251, "duration_s": 0.5, "flags": int(Flag.AT_REST), "flag_names": ["AT_REST"],
        "position_mm": [500.0, 100.0, 300.0], "standard_deviation_mm": [0.001, 0.002, 0.002],
        "covariance_mm2": None, "orientation": [0.0, 0.0, 0.0, 1.0],
        "angles_rad": [0.1 + 0.01 * number, 0.2, 0.3], "rates_rad_s": [1e-12, -1e-12, 1e-12],
        "approach": [0.0, 0.0, -1.0], "temperatures_c": {"a": 21.5, "b": 21.6, "c": None},
        "calibration": None, "tip": None, "buttons": 1,
    } | changes  # fmt: skip

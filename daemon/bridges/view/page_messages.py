"""The page's messages as JSON, made from the daemon's messages, without network code."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from armd import Flag
from armd.compensation.model.parameters import (
    BASE_PARAMETERS,
    JOINT_PARAMETERS,
    TIP_PARAMETERS,
)


def format_live(point: np.void, angles_rad: Sequence[float] | None) -> str:
    """Format the newest point of `armd.POINT`, with the joints' angles where known."""
    valid = not int(point["flags"]) & Flag.INVALID
    return json.dumps(
        {
            "seq": int(point["seq"]),
            "ms": int(point["stamp_ns"]) / 1e6,
            "p": point["position_mm"].tolist() if valid else None,
            "o": point["orientation"].tolist() if valid else None,
            "u": compute_uncertainty_mm(point["covariance_mm2"].tolist()),
            "c": point["correction_mm"].tolist() if valid else None,
            "f": int(point["flags"]),
            "b": int(point["buttons"]),
            "q": None if angles_rad is None else [_or_none(angle) for angle in angles_rad],
        }
    )


def format_measurement(content: Mapping[str, Any]) -> str:
    """Format one row of the page's list."""
    return json.dumps(
        {
            "seq": content["seq"],
            "ms": content["stamp_ns"] / 1e6,
            "id": make_measurement_id(content),
            "p": content["position_mm"],
            "sd": content.get("standard_deviation_mm"),
            "u": compute_uncertainty_mm(content.get("covariance_mm2")),
            "n": content.get("count", 1),
            "s": content.get("duration_s", 0.0),
            "f": content["flags"],
            "tip": content.get("tip"),
            "trigger": content.get("trigger", ""),
            "calibration": content.get("calibration"),
        }
    )


def make_measurement_id(content: Mapping[str, Any]) -> str:
    """Return the identifier that the page uses for a measurement."""
    return f"{content['stamp_ns']}-{content['seq']}"


def format_event(content: Mapping[str, Any]) -> str:
    return json.dumps(
        {
            "ms": content["stamp_ns"] / 1e6,
            "kind": content["kind"],
            "text": content["text"],
            "severity": content.get("severity", "info"),
        }
    )


def format_arm(
    info: Mapping[str, Any],
    calibration: Mapping[str, Any] | None,
    health: Mapping[str, Any],
    since_ms: Mapping[str, float],
) -> str:
    """Format the data that seldom change: geometry, calibration, tip, and since when."""
    described = info["calibration"]
    return json.dumps(
        {
            "serial": info["arm"]["serial_number"],
            "armd": info["armd"],
            "driver": info["driver"],
            "geometry": compute_geometry(info, calibration),
            "sensors": [sensor["name"] for sensor in info["arm"].get("temperature_sensor", [])],
            "reference_c": info["arm"]["reference_temperature_c"],
            "calibration": None
            if described is None
            else {
                "file": described["file"],
                "sha256": described["sha256"],
                "created": described["created"],
                "range_c": described["temperature_range_c"],
                "terms": described["terms"],
            },
            "tip": health["tip"],
            "tips": list(info["configuration"]["tips"]),
            "since_ms": since_ms,
            "commands": info["commands_enabled"],
            "trigger": find_trigger(info["configuration"]),
        }
    )


def find_trigger(configuration: Mapping[str, Any]) -> str | None:
    """Return what triggers a measurement: `button`, `rest`, or None.

    None means that nothing can: servos have no button, unless the driver names a servo as trigger.
    """
    driver = configuration["driver"]
    how: str = configuration["measurement"]["trigger"]
    return None if how == "button" and "trigger" in driver and driver["trigger"] is None else how


def describe_flags() -> dict[str, dict[str, str | None]]:
    """Return the meaning of each bit of a point's flags; it is the same for every arm."""
    return {
        str(flag.bit): {
            "name": flag.name,
            "title": flag.title,
            "severity": flag.severity,
            "text": f"{flag.meaning[0].upper()}{flag.meaning[1:]}.",
        }
        for flag in Flag
    }


def compute_geometry(
    info: Mapping[str, Any], calibration: Mapping[str, Any] | None
) -> dict[str, Any]:
    """Return the joints' rows θ0, d, a, α, β, with base and tip, mm and rad.

    They are those of the active calibration, or the nominal ones without one.
    """
    joints = info["arm"]["joint"]
    numbers = range(1, len(joints) + 1)
    tip = info["arm"]["tip"]
    if calibration is None:
        rows = [
            [
                math.radians(joint["theta_deg"]),
                joint["d_mm"],
                joint["a_mm"],
                math.radians(joint["alpha_deg"]),
                math.radians(joint.get("beta_deg") or 0.0),
            ]
            for joint in joints
        ]
        base, offset = [0.0] * len(BASE_PARAMETERS), tip["offset_mm"]
    else:
        constants = calibration["constants"]
        rows = [[constants.get(f"{name}_{k}", 0.0) for name in JOINT_PARAMETERS] for k in numbers]
        base = [constants.get(name, 0.0) for name in BASE_PARAMETERS]
        offset = [constants.get(name, 0.0) for name in TIP_PARAMETERS]
    radius_mm = tip["radius_mm"]
    chosen = info["configuration"]["tips"].get(info["tip"]) if info["tip"] else None
    if chosen is not None:
        offset = chosen["offset_mm"]
        radius_mm = radius_mm if chosen.get("radius_mm") is None else chosen["radius_mm"]
    limits = [[joint.get("min_deg"), joint.get("max_deg")] for joint in joints]
    return {"rows": rows, "base": base, "tip": offset, "radius_mm": radius_mm, "limits": limits}


def compute_uncertainty_mm(covariance_mm2: Sequence[float] | None) -> list[float] | None:
    """Return standard uncertainties of x, y, z.

    They are None where the covariance (xx xy xz yy yz zz) is unknown.
    """
    if covariance_mm2 is None or not all(map(math.isfinite, covariance_mm2)):
        return None
    xx, _, _, yy, _, zz = covariance_mm2
    return [math.sqrt(max(value, 0.0)) for value in (xx, yy, zz)]


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None

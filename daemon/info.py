"""The content of the info key: arm, calibration, units, and the layout of a point."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from armd import JOINTS_ENCODING, POINT, POINT_ENCODING, Flag, __version__, joints_dtype, keys
from armd.compensation.model.calibration import LoadedCalibration
from armd.daemon.config import Config, Tip

UNITS = {
    "position": "mm",
    "angle": "rad",
    "temperature": "°C",
    "stamp_ns": "ns since 1970-01-01 UTC",
    "monotonic_ns": "ns of the controller's CLOCK_MONOTONIC",
}


def describe(
    config: Config,
    calibration: LoadedCalibration | None,
    tip: str | None,
    tips: Mapping[str, Tip],
) -> dict[str, Any]:
    """Return plain JSON data; *tip* is in use, *tips* are the available ones."""
    configuration = config.file.model_copy(update={"tips": dict(tips)})
    joints = joints_dtype(config.arm.n_joints)
    return {
        "armd": __version__,
        "arm": config.arm.model_dump(mode="json", by_alias=True),
        "calibration": None if calibration is None else describe_calibration(calibration),
        "tip": tip,
        "units": UNITS,
        "point": {
            "key": keys.key(config.arm.serial_number, keys.POINT),
            "encoding": POINT_ENCODING,
            "size": POINT.itemsize,
            "layout": _describe_layout(POINT),
            "flags": {str(flag.bit): flag.name for flag in Flag},
        },
        "joints": {
            "key": keys.key(config.arm.serial_number, keys.JOINTS),
            "encoding": JOINTS_ENCODING,
            "size": joints.itemsize,
            "layout": _describe_layout(joints),
        },
        "driver": config.file.driver.kind,
        "configuration": configuration.model_dump(mode="json", by_alias=True),
        "commands_enabled": config.file.commands.enabled,
    }


def get_calibration_text(calibration: LoadedCalibration | None) -> str:
    """Return the calibration file as it was loaded; null without one."""
    return "null" if calibration is None else calibration.data.decode()


def describe_calibration(calibration: LoadedCalibration) -> dict[str, Any]:
    """Describe a calibration without its numbers: identity, validity, provenance."""
    content = calibration.content
    return {
        "file": calibration.path.name,
        "sha256": calibration.sha256,
        "created": content.created,
        "reference_temperature_c": content.reference_temperature_c,
        "temperature_range_c": content.temperature_range_c,
        "terms": len(content.terms),
        "provenance": content.provenance,
    }


def _describe_layout(message: np.dtype[np.void]) -> list[dict[str, Any]]:
    """Return the fields of a record, in order."""
    fields = []
    for name, (dtype, offset, *_) in (message.fields or {}).items():
        base, shape = dtype.subdtype or (dtype, ())
        fields.append(
            {
                "name": name,
                "offset": offset,
                "type": f"{base.kind}{base.itemsize * 8}",  # u64, i64, f32, …
                "count": shape[0] if shape else 1,
            }
        )
    return fields

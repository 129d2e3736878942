"""A measurement or a point as one line of text: presets, and templates of the user."""

from __future__ import annotations

import json
import math
import string
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from armd import Flag
from armd.daemon.bridges.tips import Tips, compute_shaft
from armd.errors import BadInput

Fields = Mapping[str, Any]
"""What a line may tell: plain numbers and words by name."""

LineFormat = Callable[[Fields], str]

FIELDS = {
    "x": 1.0, "y": 2.0, "z": 3.0, "i": 0.0, "j": 0.0, "k": 1.0,
    "seq": 1, "stamp_ns": 1, "time_s": 1.0, "flags": 0, "flag_names": "", "buttons": 0,
    "sd_x_um": 1.0, "sd_y_um": 1.0, "sd_z_um": 1.0, "u_x_um": 1.0, "u_y_um": 1.0, "u_z_um": 1.0,
    "count": 1, "tip": "", "calibration": "", "serial": "",
}  # fmt: skip
"""Names of a template's fields, each with an example of its kind."""

CSV_HEADER = (
    "stamp_ns,x_mm,y_mm,z_mm,i,j,k,u_x_mm,u_y_mm,u_z_mm,sd_x_mm,sd_y_mm,sd_z_mm,"
    "count,flags,seq,buttons,tip,calibration"
)


def format_xyz(fields: Fields) -> str:
    return "{x:.6f} {y:.6f} {z:.6f} {i:.6f} {j:.6f} {k:.6f}".format_map(fields)


def format_pcdmis(fields: Fields) -> str:
    return "X{x:.6f},Y{y:.6f},Z{z:.6f}".format_map(fields)


def format_csv(fields: Fields) -> str:
    uncertainties = [_mm(fields[f"{prefix}_{axis}_um"]) for prefix in ("u", "sd") for axis in "xyz"]
    return ",".join(
        [
            "{stamp_ns},{x:.6f},{y:.6f},{z:.6f},{i:.6f},{j:.6f},{k:.6f}".format_map(fields),
            *uncertainties,
            "{count},{flags},{seq},{buttons}".format_map(fields),
            _quoted(fields["tip"]),
            fields["calibration"],
        ]
    )


def format_jsonl(fields: Fields) -> str:
    return json.dumps(fields["json"], allow_nan=False)


PRESETS: dict[str, LineFormat] = {
    "xyz": format_xyz,
    "pcdmis": format_pcdmis,
    "csv": format_csv,
    "jsonl": format_jsonl,
}


def parse_template(text: str) -> LineFormat:
    """Return the format of a user's template, such as `{x:.3f};{y:.3f}`.

    Raises `BadInput` for a template that cannot be filled.
    """
    text = text.replace("\\t", "\t")
    try:
        for _, name, _, _ in string.Formatter().parse(text):
            if name is not None and name not in FIELDS:
                raise KeyError(name)
        text.format_map(FIELDS)
    except KeyError as error:
        expected = f"one of {', '.join(FIELDS)}"
        raise BadInput("the command line", "--template", f"field {error}", expected) from error
    except (ValueError, IndexError) as error:
        raise BadInput("the command line", "--template", str(error), "such as {x:.3f}") from error
    if "\n" in text or "\r" in text:
        raise BadInput("the command line", "--template", "a line break", "one line")
    return text.format_map


def convert_measurement(measurement: Mapping[str, Any], tips: Tips, serial: str) -> Fields | None:
    """Return a measurement's fields; None if it has no position."""
    if measurement["position_mm"] is None:
        return None
    deviation_mm = measurement["standard_deviation_mm"] or (None,) * 3
    return {
        **_place(measurement["position_mm"], tips.out_of_material(measurement)),
        **_uncertainty(measurement["covariance_mm2"]),
        **{f"sd_{axis}_um": _um(value) for axis, value in zip("xyz", deviation_mm, strict=True)},
        "seq": measurement["seq"],
        "stamp_ns": measurement["stamp_ns"],
        "time_s": measurement["stamp_ns"] * 1e-9,
        "flags": measurement["flags"],
        "flag_names": " ".join(measurement["flag_names"]),
        "buttons": measurement["buttons"],
        "count": measurement["count"],
        "tip": measurement["tip"] or "",
        "calibration": measurement["calibration"] or "",
        "serial": serial,
        "json": measurement,
    }


def convert_point(point: np.void, tips: Tips, tip: str | None, serial: str) -> Fields | None:
    """Return the fields of a record of `POINT`.

    They are None if the point is invalid, or has no position or orientation.
    """
    flags = int(point["flags"])
    if flags & Flag.INVALID:
        return None
    position, orientation = point["position_mm"].tolist(), point["orientation"].tolist()
    if not np.isfinite([*position, *orientation]).all():  # no daemon sends such a point
        return None
    covariance, correction = point["covariance_mm2"], point["correction_mm"]
    covariance_mm2 = covariance.tolist() if np.isfinite(covariance).all() else None
    calibration = int(point["calibration"])
    stamp_ns = int(point["stamp_ns"])
    common: dict[str, Any] = {
        "seq": int(point["seq"]),
        "stamp_ns": stamp_ns,
        "flags": flags,
        "buttons": int(point["buttons"]),
        "calibration": calibration.to_bytes(8, "little").hex() if calibration else None,
    }
    names = [flag.name for flag in Flag(flags)]
    return {
        **common,
        **_place(position, compute_shaft(orientation, tips.get(tip))),
        **_uncertainty(covariance_mm2),
        **{f"sd_{axis}_um": np.nan for axis in "xyz"},
        "time_s": stamp_ns * 1e-9,
        "flag_names": " ".join(str(name) for name in names),
        "count": 1,
        "tip": tip or "",
        "calibration": common["calibration"] or "",
        "serial": serial,
        "json": {
            **common,
            "position_mm": position,
            "orientation": orientation,
            "covariance_mm2": covariance_mm2,
            "correction_mm": correction.tolist() if np.isfinite(correction).all() else None,
            "flag_names": names,
            "tip": tip,
        },
    }


def _place(position_mm: Any, direction: Any) -> dict[str, float]:
    return dict(zip("xyzijk", (*position_mm, *direction), strict=True))


def _uncertainty(covariance_mm2: Any) -> dict[str, float]:
    """Return standard uncertainties of the three axes in µm.

    They are NaN without a calibration's covariance, or if a variance is below zero.
    """
    xx, _, _, yy, _, zz = covariance_mm2 or (np.nan,) * 6
    if not min(xx, yy, zz) >= 0.0:
        return {f"u_{axis}_um": np.nan for axis in "xyz"}
    return {f"u_{a}_um": 1000 * value**0.5 for a, value in zip("xyz", (xx, yy, zz), strict=True)}


def _quoted(word: str) -> str:
    """Quote a name with a comma or a quotation mark in it for CSV."""
    return '"' + word.replace('"', '""') + '"' if set(word) & set(',"') else word


def _um(value_mm: float | None) -> float:
    return np.nan if value_mm is None else 1000 * value_mm


def _mm(value_um: float) -> str:
    """Format a length in mm; empty if it is unknown."""
    return "" if math.isnan(value_um) else f"{value_um / 1000:.6f}"

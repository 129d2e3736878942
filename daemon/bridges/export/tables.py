"""Measurements as CSV, as points with normals (`.xyz`), and as PLY."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Sequence

from armd.compensation.data.sessions.columns import APPROACH
from armd.daemon.bridges.export.source import CLASH, COLUMNS, MeasurementLine
from armd.daemon.bridges.tips import Tips

UNKNOWN = (math.nan,) * 3


def as_csv(measurements: Sequence[MeasurementLine], tips: Tips) -> str:
    """Return every measurement as CSV; angles are in rad, temperatures in °C.

    A measurement without a position has empty fields. Joints and sensors are named as in a
    session's readings, so that `armd correct` can read the table.
    """
    joints = max((len(m.angles_rad or ()) for m in measurements), default=0)
    sensors = list(dict.fromkeys(name for m in measurements for name in m.temperatures_c))
    q, w = ([f"{letter}{k}" for k in range(1, joints + 1)] for letter in "qw")
    column_names = {*COLUMNS, *APPROACH}
    columns = [
        f"{CLASH}{name}" if name in column_names or re.fullmatch(r"[qw]\d+", name) else name
        for name in sensors
    ]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([*COLUMNS, *q, *w, *APPROACH, *columns])
    for m in measurements:
        unknown = [None] * joints
        writer.writerow(
            [
                m.stamp_ns,
                *_numbers(m.position_mm or UNKNOWN, 6),
                *_numbers(compute_direction(m, tips), 6),
                *_numbers(compute_uncertainty_mm(m), 6),
                *_numbers(m.standard_deviation_mm or UNKNOWN, 6),
                m.count,
                m.duration_s,
                m.flags,
                " ".join(m.flag_names),
                m.seq,
                m.buttons,
                m.trigger,
                m.tip or "",
                m.calibration or "",
                *(m.tip_offset_mm or (None,) * 3),
                m.tip_radius_mm,
                m.serial or "",
                *(m.angles_rad or unknown),
                *(m.rates_rad_s or unknown),
                *(m.approach or (None,) * 3),
                *(m.temperatures_c.get(name) for name in sensors),
            ]
        )
    return text.getvalue()


def as_xyz(measurements: Sequence[MeasurementLine], tips: Tips) -> str:
    """Return a line `x y z nx ny nz` (mm) for each point, for CloudCompare, MeshLab, Open3D."""
    return "".join(
        " ".join(_numbers((*m.position_mm, *_normal(m, tips)), 6)) + "\n"
        for m in measurements
        if m.position_mm is not None
    )


def as_ply(measurements: Sequence[MeasurementLine], tips: Tips) -> str:
    """Return ASCII PLY: position in mm, normal, uncertainty of the position in mm, flags."""
    rows = [
        " ".join(
            [*_numbers((*m.position_mm, *_normal(m, tips)), 6), f"{_norm(m):.6f}", str(m.flags)]
        )
        for m in measurements
        if m.position_mm is not None
    ]
    properties = [f"property double {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    header = [
        "ply",
        "format ascii 1.0",
        "comment measured points in mm; standard_uncertainty in mm, nan where not known",
        f"element vertex {len(rows)}",
        *properties,
        "property double standard_uncertainty",
        "property uint flags",
        "end_header",
    ]
    return "\n".join([*header, *rows, ""])


def compute_direction(m: MeasurementLine, tips: Tips) -> Sequence[float]:
    """Return the unit vector out of the material; NaN if travel and orientation are unknown."""
    if m.approach is None and m.orientation is None:
        return UNKNOWN
    return tips.out_of_material(m.model_dump())


def compute_uncertainty_mm(m: MeasurementLine) -> Sequence[float]:
    """Return standard uncertainties of x, y, z; NaN without a calibration's covariance."""
    if m.covariance_mm2 is None:
        return UNKNOWN
    xx, _, _, yy, _, zz = m.covariance_mm2
    return [math.sqrt(value) for value in (xx, yy, zz)]


def _norm(m: MeasurementLine) -> float:
    return math.hypot(*compute_uncertainty_mm(m))


def _normal(m: MeasurementLine, tips: Tips) -> Sequence[float]:
    """Return the direction, or zero if it is unknown: point cloud readers reject nan."""
    normal = compute_direction(m, tips)
    return (0.0, 0.0, 0.0) if math.isnan(normal[0]) else normal


def _numbers(values: Sequence[float], digits: int) -> list[str]:
    return ["" if math.isnan(value) else f"{value:.{digits}f}" for value in values]

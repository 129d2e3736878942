"""Draws noise of a diagnosis's size: encoders, the repeat of a point, a slow drift."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armd.arrays import F64, I64
from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.files.schema import load_json_data

#: The drift is a random walk from knot to knot: distance of knots, and the most of a session, as in
#: docs/developer/diagnosis-how.md.
KNOT_S, MOST_KNOTS = 450.0, 8
#: Readings closer than this in every joint, in sequence at one target, are one rest.
REST_RAD = 1e-4


@dataclass(frozen=True)
class FoundNoise:
    """Standard deviations of one rest."""

    encoder_rad: float = 0.0
    repeat_mm: float = 0.0  # of a point, each axis
    drift_mm: float = 0.0  # of the base, each axis, from knot to knot


def read_noise(path: Path) -> FoundNoise:
    """Read the noise from the output of `armd diagnose --json`; raises `BadInput`.

    For a file without its parts (before armd 0.2), all of `noise_floor_um` is the repeat's.
    """
    content = load_json_data(path, read_input(path))
    schema = content.get("schema") if isinstance(content, dict) else None
    if schema != "armd.diagnosis/1":
        raise BadInput(path, "schema", repr(schema), "'armd.diagnosis/1': armd diagnose --json")
    if "noise" not in content:
        floor_um = _number(path, content.get("baseline"), "baseline", "noise_floor_um")
        return FoundNoise(repeat_mm=1e-3 * floor_um / math.sqrt(3.0))
    names = ("encoder_rad", "repeat_mm", "drift_mm")
    return FoundNoise(*(_number(path, content["noise"], "noise", name) for name in names))


def _number(path: Path, table: Any, location: str, key: str) -> float:
    value: Any = table.get(key) if isinstance(table, dict) else None
    if type(value) in (int, float) and 0 <= value < math.inf:
        return float(value)
    actual = json.dumps(value) if value is not None else "nothing"
    raise BadInput(path, f"{location}.{key}", actual, "a standard deviation of 0 or more")


def number_rests(q: F64, *labels: I64) -> I64:
    """Number the rests: return the number (n,) of each row's rest.

    In a rest, angles (n, N) rad stay, at one placement and target (*labels*, (n,) each).
    """
    new = np.abs(np.diff(q, axis=0)).max(axis=1) > REST_RAD
    for label in labels:
        new |= np.diff(label) != 0
    return np.concatenate([[0], np.cumsum(new)])


def draw_drift(noise: FoundNoise, time_s: F64, rng: np.random.Generator) -> F64:
    """Draw displacements (n, 3) mm of the base at times (n,) s; none without known times."""
    span = float(np.ptp(time_s)) if len(time_s) else 0.0
    if not noise.drift_mm or not span > 0:
        return np.zeros((len(time_s), 3))
    knots = np.linspace(time_s.min(), time_s.max(), min(MOST_KNOTS, 2 + int(span / KNOT_S)))
    walk = noise.drift_mm * np.cumsum(rng.normal(size=(len(knots), 3)), axis=0)
    return np.stack([np.interp(time_s, knots, walk[:, axis]) for axis in range(3)], axis=1)

"""Reads an episode that phosphobot recorded as JSON: the joints of each step, in rad, and its time.

The form is that of `phosphobot/models/dataset.py` (JsonEpisode) and `phosphobot/utils.py`
(NumpyEncoder) of phospho-app/phosphobot, commits 42118ed and 06b6665. Its other episodes are
LeRobot data sets.
"""

from __future__ import annotations

import base64
import math
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from armd.compensation.data.foreign.table import ForeignTable
from armd.errors import BadInput
from armd.files.inputs import check_input, read_input
from armd.files.schema import load_json_data

SUFFIX = ".json"
#: The limit is large because the file contains pictures as lists of numbers.
MOST_BYTES = 512 << 20


def is_episode(path: Path) -> bool:
    """Return whether *path* has the suffix of such a file."""
    return path.suffix.lower() == SUFFIX


def read_episode(path: Path) -> ForeignTable:
    """Read all steps; raises `BadInput` for any other JSON."""
    check_input(path)
    data = load_json_data(path, read_input(path, MOST_BYTES))
    steps = data.get("steps") if isinstance(data, dict) else None
    if not isinstance(steps, list) or not steps:
        expected = "an episode of phosphobot: `steps`, each with an `observation`"
        raise BadInput(path, "the file", "another kind of JSON", expected)
    joints = [_joints(path, k, step) for k, step in enumerate(steps)]
    times = [_time_s(path, k, step) for k, step in enumerate(steps)]
    for k, row in enumerate(joints):
        if len(row) != len(joints[0]):
            actual = f"{len(row)} joints"
            raise BadInput(
                path, _locate(k, "joints_position"), actual, f"{len(joints[0])}, as before"
            )
    began_s = _began_s(data)
    header = ["time_s", *(f"joint {k} [rad]" for k in range(1, len(joints[0]) + 1))]
    rows = [[repr(began_s + t), *map(repr, row)] for t, row in zip(times, joints, strict=True)]
    assumed = ["an episode of phosphobot: joints by their place in joints_position, base to wrist"]
    return ForeignTable(path, header, rows, assumed)


def _locate(step: int, name: str) -> str:
    return f"steps[{step}].observation.{name}"


def _joints(path: Path, k: int, step: Any) -> list[float]:
    value = _observation(path, k, step).get("joints_position")
    try:
        array = np.asarray(_decoded(value), dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise _no_list(path, k, value) from error
    if array.ndim != 1 or not array.size:
        raise _no_list(path, k, value)
    joints: list[float] = array.tolist()
    return joints


def _no_list(path: Path, k: int, value: Any) -> BadInput:
    expected = "a list of angles in rad, one of each motor"
    return BadInput(path, _locate(k, "joints_position"), repr(value)[:60], expected)


def _decoded(value: Any) -> Any:
    """Return a list unchanged, or decode one of phosphobot's two forms of an array."""
    if isinstance(value, dict) and "__numpy__" in value:
        content = base64.b64decode(str(value["__numpy__"]), validate=True)
        return np.frombuffer(content, dtype=np.dtype(str(value.get("dtype"))))
    if isinstance(value, dict) and value.get("_type") == "ndarray":
        return value.get("data")
    return value


def _time_s(path: Path, k: int, step: Any) -> float:
    value = _observation(path, k, step).get("timestamp")
    seconds = _finite(value)
    if seconds is None:
        raise BadInput(path, _locate(k, "timestamp"), repr(value)[:60], "seconds since the first")
    return seconds


def _observation(path: Path, k: int, step: Any) -> dict[str, Any]:
    observation = step.get("observation") if isinstance(step, dict) else None
    if not isinstance(observation, dict):
        actual = repr(step)[:60]
        raise BadInput(path, f"steps[{k}]", actual, "a step with its observation")
    return observation


def _began_s(data: dict[str, Any]) -> float:
    """Return the Unix time of the episode's beginning, or 0 if it is not stated."""
    metadata = data.get("metadata")
    created = metadata.get("created_at") if isinstance(metadata, dict) else None
    return _finite(created) or 0.0


def _finite(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    with suppress(OverflowError):
        number = float(value)
        return number if math.isfinite(number) else None
    return None

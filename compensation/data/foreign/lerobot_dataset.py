"""Reads a LeRobot data set as a table: the observed joints and the time of each frame.

Versions 2 (a file an episode) and 3 (many episodes a file) have the same columns; meta/info.json
holds the names of `observation.state`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from armd.compensation.data.foreign.table import ForeignTable, has_file
from armd.errors import BadInput
from armd.files.inputs import MOST_JSON_BYTES, check_input, read_input
from armd.files.schema import load_json_data
from armd.terminal.counted import format_count

STATE, INFO, SUFFIX = "observation.state", Path("meta", "info.json"), ".parquet"
TIME, EPISODE = "timestamp", "episode_index"
#: phosphobot's names, from the ids of its servos. Joints are in order, and second servos are
#: skipped.
SERVO = re.compile(r"motor_\d+")


def is_dataset(path: Path) -> bool:
    """Return whether *path* is a data set's file or folder."""
    return path.suffix.lower() == SUFFIX or has_file(path, INFO)


def read_dataset(path: Path) -> ForeignTable:
    """Read all frames of a file, or of the folder's files; raises `BadInput` if it is no
    data set.
    """
    folder = path if path.is_dir() else _folder_of(path)
    files = sorted((path / "data").rglob(f"*{SUFFIX}")) if path.is_dir() else [path]
    if not files:
        raise BadInput(path / "data", "the folder", f"no *{SUFFIX}", "the files of a data set")
    frames = [_read(file) for file in files]
    state = np.concatenate([frame[STATE] for frame in frames])
    names = _names(folder, state.shape[1])
    episode = np.concatenate([frame[EPISODE] for frame in frames])
    time_s = np.concatenate([frame[TIME] for frame in frames])
    order = np.lexsort((time_s, episode))
    assumed = [f"joints are {STATE} of {format_count(len(order), 'frame')}; actions are left out"]
    time_s = _one_after_another(time_s[order], episode[order])
    if count := len(set(episode.tolist())) - 1:
        assumed.append(
            f"{count + 1} episodes stand one after another: the pauses between are not recorded"
        )
    rows = [[repr(t), *map(str, row)] for t, row in zip(time_s.tolist(), state[order], strict=True)]
    return ForeignTable(path, ["time_s", *names], rows, assumed)


def _folder_of(file: Path) -> Path:
    """Return the folder of the data set that contains *file*; raises `BadInput`."""
    check_input(file)
    for folder in file.resolve().parents:
        if (folder / INFO).is_file():
            return folder
    actual, expected = "no meta/info.json in a folder above it", "a file within a LeRobot data set"
    raise BadInput(file, "the data set", actual, expected)


def _read(file: Path) -> dict[str, np.ndarray]:
    check_input(file)
    try:
        table = pa.parquet.read_table(file)
    except (pa.ArrowException, OSError) as error:
        actual = " ".join(str(error).split())[:100]
        raise BadInput(file, "the file", actual, "a parquet file") from error
    for name in (STATE, TIME, EPISODE):
        if name not in table.column_names:
            actual = f"no such column among {', '.join(table.column_names[:8])}"
            raise BadInput(file, name, actual, "a LeRobot data set's")
    values = table.column(STATE).to_pylist()
    width = len(values[0]) if values and isinstance(values[0], list) else 0
    if not width or any(not isinstance(row, list) or len(row) != width for row in values):
        raise BadInput(file, STATE, "no list of one length in every row", "one number per motor")
    return {
        STATE: np.array(values, dtype=np.float32).reshape(-1, width),
        TIME: table.column(TIME).to_numpy().astype(float),
        EPISODE: table.column(EPISODE).to_numpy().astype(np.int64),
    }


def _names(folder: Path, width: int) -> Sequence[str]:
    """Return the names of the motors; numbers from 1 if the data set has none.
    Raises `BadInput`.
    """
    path = folder / INFO
    info: Any = load_json_data(path, read_input(path, MOST_JSON_BYTES))
    try:
        names = info["features"][STATE]["names"]
    except (KeyError, TypeError):
        names = None
    if isinstance(names, dict) and len(names) == 1:  # {"motors": […]}, {"axes": […]}
        (names,) = names.values()
    if names is None:
        return [f"{STATE} {k}" for k in range(1, width + 1)]
    if not isinstance(names, list) or len(names) != width:
        actual = repr(names)[:60]
        raise BadInput(path, f"features.{STATE}.names", actual, f"{width} names, as the data have")
    if all(SERVO.fullmatch(str(name)) for name in names):
        return [f"joint {k}" for k in range(1, width + 1)]
    return [str(name) for name in names]


def _one_after_another(time_s: np.ndarray, episode: np.ndarray) -> np.ndarray:
    """Return the seconds of consecutive episodes; each episode's own seconds begin at 0."""
    between = np.diff(time_s)
    begins = np.flatnonzero(np.diff(episode)) + 1
    if not len(begins):
        return time_s
    shift = np.zeros(len(time_s))
    shift[begins] = float(np.median(between[between > 0])) - between[begins - 1]
    later: np.ndarray = time_s + np.cumsum(shift)
    return later

"""Write points of an arm as Parquet files by arm and day: `armd record --lake`.

Each file appears whole or not at all, and a new one every half minute, so a killed recorder loses
no more than that. docs/how-to/scale.md describes the columns.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from armd import POINT, joints_dtype
from armd.arrays import I64
from armd.compensation.data.tables.recorded import CALIBRATION, COVARIANCE, FLAGS, POSITION, STAMP
from armd.compensation.data.tables.writing import open_writer, write_group
from armd.errors import BadInput
from armd.files.locking import O_CLOEXEC, O_NOFOLLOW, lock_file
from armd.files.outputs import check_output_folder
from armd.files.writing import explain_os_errors, flush_folder, replace_file

#: Seconds of points that are held in memory until their file is written.
FILE_S = 30.0
#: After this time without joints, a point's joints count as lost on the way.
JOINTS_NS = 1_000_000_000
#: Points and joints begin with `seq` and `stamp_ns`, which are equal for a pair.
KEY_BYTES = 16
LOCK = ".armd-lake.lock"


class Lake:
    """Writes one arm's points below a folder, with one writer for each arm. Close it."""

    def __init__(self, folder: Path, serial: str, n_joints: int, sensors: list[str]) -> None:
        """Lock the arm's folder.

        Raises `BadInput` if it cannot be written, or if another recorder writes this arm.
        """
        self.folder = folder / f"serial={quote(serial, safe=' ')}"
        self._schema = _make_schema(n_joints, sensors)
        self._sensors = sensors
        self._joints_dtype = joints_dtype(n_joints)
        self._points: list[bytes] = []
        self._joints: dict[bytes, bytes] = {}
        #: instants and values of temperatures: the last before the waiting points, and all since
        self._heard: deque[tuple[int, list[float]]] = deque()
        self.rows = 0
        self.files = 0
        self.without_joints = 0
        self._lock = self._lock_folder()

    def take_temperatures(self, stamp_ns: int, celsius: Mapping[str, float | None]) -> None:
        """Set the temperatures of points from this instant on; None is missing."""
        values = [celsius.get(name) for name in self._sensors]
        self._heard.append((stamp_ns, [np.nan if value is None else value for value in values]))

    def take(self, points: Iterable[bytes], joints: Iterable[bytes]) -> None:
        """Take payloads of the point key and of the joints key, as published."""
        self._points += points
        size = self._joints_dtype.itemsize
        self._joints |= {data[:KEY_BYTES]: data for data in joints if len(data) == size}

    def write(self, *, to_the_end: bool = False) -> None:
        """Write the points taken, a file for each day.

        Points whose joints may still come remain, unless *to_the_end*.
        """
        n = len(self._points) if to_the_end else self._count_decided()
        if n:
            rows = np.frombuffer(b"".join(self._points[:n]), POINT)
            joint_frames = [self._joints.get(point[:KEY_BYTES]) for point in self._points[:n]]
            table = self._table(rows, self._joined(joint_frames))
            days = rows["stamp_ns"].astype("datetime64[ns]").astype("datetime64[D]")
            for day in np.unique(days):
                self._write_file(str(day), table.filter(pa.array(days == day)))
            last_ns = int(rows["stamp_ns"].max())
            self.without_joints += joint_frames.count(None)
            del self._points[:n]
            # Keep only joints of points that may still come.
            stamps = np.frombuffer(b"".join(key[8:] for key in self._joints), "<i8").tolist()
            self._joints = {
                key: data
                for (key, data), stamp_ns in zip(self._joints.items(), stamps, strict=True)
                if stamp_ns > last_ns
            }
            while len(self._heard) > 1 and self._heard[1][0] <= last_ns:
                self._heard.popleft()

    def close(self) -> None:
        """Write the remaining points, and release the arm's folder."""
        try:
            self.write(to_the_end=True)
        finally:
            os.close(self._lock)

    def _lock_folder(self) -> int:
        check_output_folder(self.folder)
        path = self.folder / LOCK
        with explain_os_errors(path):
            self.folder.mkdir(parents=True, exist_ok=True)
            handle = os.open(path, os.O_RDWR | os.O_CREAT | O_NOFOLLOW | O_CLOEXEC, 0o666)
        try:
            lock_file(handle, wait=False)
        except BlockingIOError as error:
            os.close(handle)
            problem = "another recorder that writes this arm"
            raise BadInput(self.folder, "the folder", problem, "one recorder an arm") from error
        return handle

    def _count_decided(self) -> int:
        """Count the points that have their joints, or will never have them."""
        n = len(self._points)
        if not n:
            return 0
        newest_ns = _read_stamp_ns(self._points[-1])
        while n and self._points[n - 1][:KEY_BYTES] not in self._joints:
            if _read_stamp_ns(self._points[n - 1]) < newest_ns - JOINTS_NS:
                break
            n -= 1
        return n

    def _joined(self, joint_frames: list[bytes | None]) -> npt.NDArray[np.void]:
        """Return the joints (n,), with NaN where they are missing."""
        unknown = np.zeros(1, self._joints_dtype)
        unknown["angle_rad"] = unknown["rate_rad_s"] = np.nan
        missing = unknown.tobytes()
        return np.frombuffer(b"".join(data or missing for data in joint_frames), self._joints_dtype)

    def _table(self, points: npt.NDArray[np.void], joints: npt.NDArray[np.void]) -> pa.Table:
        columns: list[npt.NDArray[Any]] = [
            points["seq"], points["stamp_ns"], *joints["angle_rad"].T, *joints["rate_rad_s"].T,
            *self._temperatures(points["stamp_ns"]).T, *points["position_mm"].T,
            *points["covariance_mm2"].T, points["flags"], points["calibration"], points["buttons"],
        ]  # fmt: skip
        arrays = [
            pa.array(np.ascontiguousarray(column), field.type, from_pandas=True)
            for column, field in zip(columns, self._schema, strict=True)
        ]
        return pa.Table.from_arrays(arrays, schema=self._schema)

    def _temperatures(self, stamp_ns: I64) -> npt.NDArray[np.float64]:
        """Return the last temperatures before each instant (n, S).

        An instant before all of them gets the first ones.
        """
        if not self._heard:
            return np.full((len(stamp_ns), len(self._sensors)), np.nan)
        since_ns = np.array([instant for instant, _ in self._heard])
        last = np.maximum(np.searchsorted(since_ns, stamp_ns, side="right") - 1, 0)
        values = np.array([celsius for _, celsius in self._heard]).reshape(len(since_ns), -1)
        return values[last]

    def _write_file(self, day: str, table: pa.Table) -> None:
        folder = self.folder / f"day={day}"
        with explain_os_errors(folder):
            if not folder.is_dir():
                folder.mkdir()
                flush_folder(self.folder)
        seq, stamp_ns = table["seq"][0].as_py(), table[STAMP][0].as_py()
        path = folder / f"{stamp_ns}-{seq}.parquet"
        with replace_file(path) as part, open_writer(path, part, path.suffix, self._schema) as out:
            write_group(path, out, [table])
        self.rows += len(table)
        self.files += 1


def _read_stamp_ns(point: bytes) -> int:
    return int.from_bytes(point[8:KEY_BYTES], "little", signed=True)


def _make_schema(n_joints: int, sensors: list[str]) -> pa.Schema:
    joints = range(1, n_joints + 1)
    before = [("seq", pa.uint64()), (STAMP, pa.int64())]
    before += [(f"q{k}", pa.float64()) for k in joints] + [(f"w{k}", pa.float32()) for k in joints]
    after = [(name, pa.float64()) for name in POSITION]
    after += [(name, pa.float32()) for name in COVARIANCE]
    after += [(FLAGS, pa.uint32()), (CALIBRATION, pa.uint64()), ("buttons", pa.uint32())]
    column_names = {name for name, _ in [*before, *after]}
    for name in sensors:
        if name in column_names:
            expected = f"another name, as temperature_{name}: a lake has another column of this one"
            raise BadInput("the arm", "temperature_sensor.name", repr(name), expected)
    return pa.schema([*before, *((name, pa.float64()) for name in sensors), *after])

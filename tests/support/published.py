"""Payloads as a daemon publishes them, of an arm whose joints move slowly, and lakes of them."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from armd import POINT, joints_dtype
from armd.compensation.model.calibration import save_calibration
from armd.daemon.files.lake import Lake
from support import synthetic
from support.drawn import drawn

SECOND_NS = 1_000_000_000


def day_ns(text: str) -> int:
    """Midnight UTC of an ISO date, Unix nanoseconds."""
    when = datetime.datetime.fromisoformat(text).replace(tzinfo=datetime.UTC)
    return int(when.timestamp()) * SECOND_NS


def published(
    n: int, start_ns: int, *, first: int = 0, n_joints: int = 6, step_ns: int = 1_000_000
) -> tuple[np.ndarray, np.ndarray]:
    """Points (n,) of `POINT` and joints (n,), `seq` from *first* on; figures that all differ."""
    rng = np.random.default_rng(first + n)
    points, joints = np.zeros(n, POINT), np.zeros(n, joints_dtype(n_joints))
    points["seq"] = joints["seq"] = first + np.arange(n)
    points["stamp_ns"] = joints["stamp_ns"] = start_ns + step_ns * np.arange(n)
    points["position_mm"] = rng.normal(size=(n, 3))
    points["covariance_mm2"] = rng.normal(size=(n, 6)) ** 2
    points["calibration"] = 0x8877665544332211
    joints["n"] = n_joints
    joints["angle_rad"] = np.cumsum(rng.normal(scale=1e-3, size=(n, n_joints)), axis=0)
    joints["rate_rad_s"] = rng.normal(size=(n, n_joints))
    return points, joints


def save_lagged(path: Path, serial: str, lag_s: float, seed: int) -> None:
    """A calibration of `synthetic.arm`, but for its serial number, in which a length lags."""
    arm = synthetic.arm()
    truth = synthetic.disturbed(arm, np.random.default_rng(seed))
    lagged = {"kind": "temperature", "weights": {"t2": 1.0}, "lag_s": lag_s}
    calibration = drawn(
        arm,
        values=truth,
        arm=serial,
        terms=[{"parameter": "a_2", "coefficient": 1e-2, "basis": [lagged]}],
        noise={"encoder_rad": [1e-6] * 6, "reading_mm": 2e-3, "temperature_c": 0.0},
    )
    save_calibration(path, calibration)


def payloads(rows: np.ndarray) -> list[bytes]:
    return [row.tobytes() for row in rows]


def make_lake(folder: Path, serial: str, days: Sequence[str], rows: int, *, files: int = 2) -> None:
    """A lake of one arm with six joints and sensors: *rows* a day in *files*, from noon on."""
    lake = Lake(folder, serial, 6, [f"t{k}" for k in range(1, 7)])
    for number, day in enumerate(days):
        start_ns = day_ns(day) + 43200 * SECOND_NS
        points, joints = published(rows, start_ns, first=number * rows)
        for second in range(rows // 1000 + 1):
            celsius = {f"t{k}": 20 + 0.1 * k + 0.01 * second for k in range(1, 7)}
            lake.take_temperatures(start_ns + second * SECOND_NS, celsius)
        for part in np.array_split(np.arange(rows), files):
            lake.take(payloads(points[part]), payloads(joints[part]))
            lake.write(to_the_end=True)
    lake.close()

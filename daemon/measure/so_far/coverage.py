"""The coverage of a guided measurement: targets by placement, joint ranges, temperatures."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.daemon.measure.plan.stations import Plan
from armd.daemon.measure.so_far.progress import Progress

FULL_TURN_DEG = 360.0


def count_targets(plan: Plan, progress: Progress) -> list[dict[str, Any]]:
    """Count the readings taken and wanted of each target in each placement of the plan."""
    planned = Counter((station.placement, station.target) for station in plan.stations)
    counts = Counter((reading.placement, reading.target) for reading in progress.readings)
    left_out = Counter(
        (plan.stations[i].placement, plan.stations[i].target) for i in progress.skipped
    )
    return [
        {
            "placement": placement,
            "target": target,
            "done": counts[placement, target],
            "wanted": count,
            "left_out": left_out[placement, target],
        }
        for (placement, target), count in planned.items()
    ]


def describe_joints(arm: Arm, progress: Progress) -> list[dict[str, Any]]:
    """List each joint's measured angles, and their share of its range."""
    angles = np.degrees(collect_angles(progress, arm.n_joints))
    rows = []
    for k, joint in enumerate(arm.joint):
        low = float(angles[:, k].min()) if len(angles) else None
        high = float(angles[:, k].max()) if len(angles) else None
        full = FULL_TURN_DEG
        if joint.min_deg is not None and joint.max_deg is not None:
            full = joint.max_deg - joint.min_deg
        rows.append(
            {
                "joint": k + 1,
                "low_deg": low,
                "high_deg": high,
                "min_deg": joint.min_deg,
                "max_deg": joint.max_deg,
                "share": 0.0 if low is None or high is None else min((high - low) / full, 1.0),
            }
        )
    return rows


def describe_temperatures(arm: Arm, progress: Progress) -> list[dict[str, Any]]:
    """List each sensor's lowest and highest value at a reading, °C."""
    rows = []
    for name in arm.sensors:
        values = [reading.measurement["temperatures_c"].get(name) for reading in progress.readings]
        measured = [value for value in values if value is not None]
        low, high = (min(measured), max(measured)) if measured else (None, None)
        rows.append({"sensor": name, "low_c": low, "high_c": high})
    return rows


def collect_angles(progress: Progress, n_joints: int) -> F64:
    """Return the joint angles (n, N) rad of the readings."""
    rows = [reading.measurement["angles_rad"] for reading in progress.readings]
    return np.array(rows, dtype=float).reshape(len(rows), n_joints)

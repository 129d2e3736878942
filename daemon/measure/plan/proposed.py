"""The check that a history of interim checks proposes, as poses on two seats."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from armd.compensation.interim.checks.chain import REPORT
from armd.compensation.model.arm import Arm
from armd.daemon.interim_checks import MOST_BYTES
from armd.daemon.measure.plan.poses import Pose, describe_pose
from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.files.schema import load_json_data

SCHEMA = "armd.interim/1"
SEATS = 2


def load_proposed_check(history: Path, arm: Arm) -> list[Pose]:
    """Return the poses that the last `armd interim add` or `report` proposed.

    They alternate between the seats. Raises `BadInput` for a history of another arm, without a
    result, or without a proposal.
    """
    path = history / REPORT
    if not path.exists():
        expected = "the result of `armd interim add` or `armd interim report`"
        raise BadInput(path, "the file", "nothing", expected)
    result = load_json_data(path, read_input(path, MOST_BYTES))
    if not isinstance(result, dict) or result.get("schema") != SCHEMA:
        raise BadInput(path, "schema", "another file", repr(SCHEMA))
    if result.get("arm") != arm.serial_number:
        expected = f"{arm.serial_number!r}, the arm in use"
        raise BadInput(path, "arm", repr(result.get("arm")), expected)
    after = result.get("next_check")
    if not isinstance(after, dict) or not after.get("poses_deg"):
        expected = "a cause in doubt: without --proposed the usual check is measured"
        raise BadInput(path, "next_check", "no poses", expected)
    try:
        return _parse_poses(after, arm)
    except (KeyError, TypeError, ValueError, IndexError) as error:
        expected = "seats_mm, poses_deg and approach, as `armd interim report` writes them anew"
        raise BadInput(path, "next_check", json.dumps(after)[:60], expected) from error


def _parse_poses(after: dict[str, Any], arm: Arm) -> list[Pose]:
    seats = [_parse_numbers(seat, 3) for seat in after["seats_mm"]]
    postures = [_parse_numbers(pose, arm.n_joints) for pose in after["poses_deg"]]
    if len(seats) != SEATS:
        raise ValueError
    poses = []
    for i, (posture, signs) in enumerate(zip(postures, after["approach"], strict=True)):
        row = {f"approach_joint_{k}": sign for k, sign in enumerate(signs, 1)}
        x, y, z = seats[i % len(seats)]
        how = describe_pose(i + 1, row, arm.n_joints, (), "the proposed check")
        poses.append(Pose((x, y, z), posture, how))
    return poses


def _parse_numbers(values: list[float], count: int) -> tuple[float, ...]:
    numbers = tuple(float(value) for value in values)
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise ValueError
    return numbers

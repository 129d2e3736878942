"""Convert the poses of `armd design` to stations, and place the artefact for them.

`armd design` chooses poses as if a target stood at every wanted point. An artefact has its balls at
fixed positions. So it is placed where they are nearest to the tips of the poses, and each pose uses
the ball that is then nearest. A table that names placements and balls itself is followed.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from armd.arrays import F64, I64
from armd.compensation.data.sessions.format import Artefact
from armd.compensation.estimate.placements.rigid_motions import fit_by_kabsch
from armd.daemon.measure.plan.stations import Station
from armd.errors import BadInput
from armd.files.inputs import MOST_TOML_BYTES, read_input

#: Random initial orientations of the artefact, and steps of the search from each.
TURNS, STEPS = 200, 20
SIDES = {"+": "up", "-": "down"}


class Pose(NamedTuple):
    """A row of the table of poses."""

    tip_mm: tuple[float, float, float]  # base frame
    posture_deg: tuple[float, ...]  # joint angles as read
    how: str  # how to approach it, and the temperatures, in words
    placement: str = ""  # of the artefact, and its target, where the table names them
    target: str = ""


def read_poses(path: Path, n_joints: int, sensors: Sequence[str]) -> list[Pose]:
    """Read a table that `armd design -o` wrote; raises `BadInput`."""
    text = read_input(path, MOST_TOML_BYTES).decode("utf-8-sig", "replace")
    rows = csv.DictReader(io.StringIO(text))
    tip = [f"{axis}_mm" for axis in "xyz"]
    joints = [f"q{k}_deg" for k in range(1, n_joints + 1)]
    missing = [name for name in (*tip, *joints) if name not in (rows.fieldnames or [])]
    if missing:
        raise BadInput(path, "header", f"no column {missing[0]}", "a table of `armd design -o`")
    poses = []
    for number, row in enumerate(rows, 2):
        x, y, z = (_parse_number(path, number, row, name) for name in tip)
        posture = tuple(_parse_number(path, number, row, name) for name in joints)
        how = describe_pose(number - 1, row, n_joints, sensors)
        named = (row.get("placement") or "", row.get("target") or "")
        poses.append(Pose((x, y, z), posture, how, *named))
    if not poses:
        raise BadInput(path, "the file", "no pose", "a table of `armd design -o`")
    return poses


def make_stations(poses: Sequence[Pose], artefact: Artefact, placement: str) -> list[Station]:
    """Return the stations, pose after pose.

    Each is at the target that the table names, else at the nearest one. Seats at unknown positions
    are used in turn, and a hint says to place each near its poses. Raises `BadInput` for a target
    that the artefact lacks.
    """
    if all(pose.placement and pose.target for pose in poses):
        return _make_named_stations(poses, artefact)
    names = artefact.target_names
    located = np.flatnonzero(np.isfinite(artefact.positions_mm()).all(axis=1))
    targets, hint = [names[i % len(names)] for i in range(len(poses))], ""
    tips = np.array([pose.tip_mm for pose in poses])
    if len(located) > 1:
        local = artefact.positions_mm()[located]
        placed, nearest = _place_targets(local, tips)
        targets = [names[located[i]] for i in nearest]
        ends = [
            f"{names[located[i]]} near {_describe_point(placed[i])}"
            for i in _choose_far_targets(local)
        ]
        hint = f"; the artefact with {', '.join(ends)}"
    elif len(names) == 1 or not len(located):
        places = [tips[i :: len(names)].mean(axis=0) for i in range(min(len(names), len(tips)))]
        hint = "; " + ", ".join(
            f"{name} near {_describe_point(place)}"
            for name, place in zip(names, places, strict=False)
        )
    return [
        Station(
            placement=placement,
            target=target,
            how=pose.how + (hint if number == 0 else ""),
            posture_deg=pose.posture_deg,
        )
        for number, (pose, target) in enumerate(zip(poses, targets, strict=True))
    ]


def _make_named_stations(poses: Sequence[Pose], artefact: Artefact) -> list[Station]:
    """Return the stations of a table that names placements and targets.

    The first pose of each placement says where to put the artefact.
    """
    stations, begun = [], set()
    for pose in poses:
        if pose.target not in artefact.target_names:
            expected = f"targets of --artefact: {', '.join(artefact.target_names[:20])}"
            raise BadInput("the table of poses", "target", repr(pose.target), expected)
        hint = ""
        if pose.placement not in begun:
            begun.add(pose.placement)
            tips = {p.target: p.tip_mm for p in poses if p.placement == pose.placement}
            local = np.array(list(tips.values()))
            corners = _choose_far_targets(local) if len(tips) > 1 else [0]
            ends = [f"{list(tips)[i]} near {_describe_point(local[i])}" for i in corners]
            hint = f"; the artefact with {', '.join(ends)}"
        stations.append(
            Station(
                placement=pose.placement,
                target=pose.target,
                how=pose.how + hint,
                posture_deg=pose.posture_deg,
            )
        )
    return stations


def _place_targets(local: F64, tips: F64) -> tuple[F64, I64]:
    """Place the targets (m, 3) nearest to the tips (n, 3), in the base frame.

    Also returns the nearest target (n,) of each tip. Both are found in alternation, from many
    initial orientations (iterative closest points, Besl and McKay 1992).
    """
    turns = Rotation.random(TURNS, random_state=0).as_matrix()
    group, weight = np.zeros(len(tips), np.int64), np.ones(len(tips))
    best, least_missed = (local, np.zeros(len(tips), np.int64)), math.inf
    for turn in turns:
        placed = (local - local.mean(axis=0)) @ turn.T + tips.mean(axis=0)
        for _ in range(STEPS):
            nearest = np.linalg.norm(tips[:, None] - placed, axis=2).argmin(axis=1)
            rotation, translation = fit_by_kabsch(local[nearest], tips, weight, group, 1)
            placed = local @ rotation[0].T + translation[0]
        away = np.linalg.norm(tips[:, None] - placed, axis=2)
        missed = float((away.min(axis=1) ** 2).sum())
        if missed < least_missed:
            best, least_missed = (placed, away.argmin(axis=1)), missed
    return best


def _choose_far_targets(local: F64) -> list[int]:
    """Choose up to three targets that show how an artefact stands.

    They are the farthest two, and the one farthest from these.
    """
    distance_mm = np.linalg.norm(local[:, None] - local, axis=2)
    first, second = np.unravel_index(int(distance_mm.argmax()), distance_mm.shape)
    third = int(np.minimum(distance_mm[first], distance_mm[second]).argmax())
    return list(dict.fromkeys([int(first), int(second), third]))


def _describe_point(point: F64) -> str:
    return "[" + ", ".join(f"{value:.0f}" for value in point) + "] mm"


def describe_pose(
    number: int,
    row: Mapping[str, str],
    n_joints: int,
    sensors: Sequence[str],
    whose: str = "`armd design`",
) -> str:
    """Describe a *row* of the table in words: how to approach the pose, and temperatures."""
    sides = [
        f"{k} {SIDES[side]}"
        for k in range(1, n_joints + 1)
        if (side := row.get(f"approach_joint_{k}", "")) in SIDES
    ]
    words = f"pose {number} of {whose}, as nearly as the target allows"
    if sides:
        words += f"; come to rest turning joints {', '.join(sides)}"
    warm = [f"{name} {row[f'{name}_c']} °C" for name in sensors if row.get(f"{name}_c")]
    return words + (f"; at {', '.join(warm)}" if warm else "")


def _parse_number(path: Path, line: int, row: Mapping[str, str], name: str) -> float:
    try:
        value = float(row[name])
        if not math.isfinite(value):
            raise ValueError
    except (TypeError, ValueError):
        raise BadInput(path, f"line {line}, {name}", repr(row[name]), "a number") from None
    return value

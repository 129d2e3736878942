"""Guided measuring of surfaces: touched anywhere, written as a session, scatter told."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armd.arrays import F64
from armd.compensation.data.sessions.format import Artefact
from armd.compensation.data.sessions.session import load_session
from armd.daemon.measure.in_use import MeasuredWith
from armd.daemon.measure.measuring import Measuring
from armd.daemon.measure.plan.kinds import make_plan
from armd.daemon.measure.plan.stations import Wishes
from armd.errors import BadInput
from armd.files.schema import validate
from support.pressed import pressed
from support.small_arm import small_arm

ARM = small_arm()
IN_USE = MeasuredWith(ARM, None, None, None)
CORNER = validate(
    "corner",
    {
        "name": "corner",
        "surface": [
            {"name": "ball", "kind": "sphere", "radius_mm": 12.7},
            {"name": "foot", "kind": "plane"},
            {"name": "head", "kind": "plane"},
        ],
        "distance": [{"between": ["foot", "head"], "length_mm": 25.0}],
    },
    Artefact,
)
SEATED = validate(
    "seated",
    {"name": "seated", "target": [{"name": "S"}], "surface": [{"name": "plate", "kind": "plane"}]},
    Artefact,
)


def press(number: int, point_mm: F64) -> dict[str, Any]:
    return pressed(number, position_mm=point_mm.tolist())


def test_surfaces_are_touched_anywhere_and_their_scatter_is_told(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    plan = make_plan("artefact", ARM, CORNER, Wishes(placements=["P1"], repeats=12))
    assert len(plan.stations) == 36
    heights = {"foot": 100.0, "head": 131.0}
    with Measuring(tmp_path / "corner", plan, IN_USE) as measuring:
        for number in range(1, 37):
            following = measuring.state()["next"]
            assert following["position_mm"] is None  # anywhere
            if (name := following["target"]) == "ball":
                way = rng.normal(size=3)
                point = np.array([400.0, 0.0, 200.0]) + 15.7 * way / np.linalg.norm(way)
            else:
                point = np.array([*rng.uniform(0.0, 40.0, 2), heights[name]])
            point += 0.01 * rng.normal(size=3)
            assert measuring.offer(press(number, point))["event"] == "reading"
        assert measuring.complete
        told = measuring.state()["estimate"]
    # Three components as large as the one across, 0.01 mm; unknowns of a sphere and two planes.
    assert told["freedom"] == 36 - 4 - 3 - 3
    assert told["rms_um"] == pytest.approx(1e1 * np.sqrt(3.0), rel=0.3)
    session = load_session(tmp_path / "corner", ARM)
    assert session.artefact.surfaces == CORNER.surfaces
    assert session.artefact.distances == CORNER.distances
    assert [session.artefact.target_names[k] for k in session.target[:3]] == [
        "ball", "foot", "head",
    ]  # fmt: skip


def test_plans_for_calibration_and_verification() -> None:
    plan = make_plan("artefact", ARM, CORNER, Wishes())
    assert len(plan.stations) == 6 * 3 * 40  # six placements, each surface 40 times
    assert len({station.placement for station in plan.stations}) == 6
    assert all("anywhere" in station.how for station in plan.stations)
    mixed = make_plan("artefact", ARM, SEATED, Wishes(repeats=2))
    assert [s.target for s in mixed.stations[:4]] == ["S", "S", "plate", "plate"]
    verify = make_plan("verify", ARM, CORNER, Wishes())
    counted = [(s.placement, s.target) for s in verify.stations]
    assert counted.count(("SPHERE1", "ball")) == counted.count(("SPHERE2", "ball")) == 25
    assert counted.count(("BLOCK1", "foot")) == counted.count(("BLOCK1", "head")) == 8
    assert len(counted) == 66


@pytest.mark.parametrize("kind", ["poses", "interim"])
def test_what_goes_to_named_points_refuses_surfaces(kind: Any, tmp_path: Path) -> None:
    poses = tmp_path / "poses.csv"
    wishes = Wishes(poses=poses) if kind == "poses" else Wishes()
    with pytest.raises(BadInput, match=r"'ball', a sphere, expected points: `armd measure`"):
        make_plan(kind, ARM, CORNER, wishes)

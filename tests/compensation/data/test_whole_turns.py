"""tests/field/full-turns: angles a whole turn off, with limits that decide the turn and without."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session, load_sessions
from armd.compensation.data.soundness.turns import find_whole_turns
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.model.arm import Arm, load_arm
from armd.simulator.measured.noise import Noise
from armd.simulator.plants.causes import plant_all
from armd.simulator.plants.plant import parse_plant
from armd.simulator.sessions import KINDS, write_campaign

TURNED = ("session-3", "session-4", "session-7")


def arm_of(*limits: tuple[float | None, float | None]) -> Arm:
    return Arm.model_validate(
        {
            "schema": "armd.arm/1",
            "serial_number": "TURNS",
            "joint": [{"a_mm": 100.0, "min_deg": low, "max_deg": high} for low, high in limits],
        }
    )


@pytest.mark.parametrize(
    ("limits", "degrees", "turns"),
    [
        ((-155, 5), [-155, 5, 205, 365, -515, 7, -400], [0, 0, 1, 1, -1, 0, -1]),
        ((-180, 180), [-179, 179, 190, 541, -190], [0, 0, 1, 2, -1]),
        ((0, 360), [-10, 350, 370], [-1, 0, 1]),
        ((-200, 200), [170, 190, 250, -250, 390, 900], [0, 0, 1, -1, 1, 0]),
        ((-400, 400), [390, 500, -500], [0, 0, 0]),  # two turns lead inside
        ((None, 90), [-300, 500], [0, 0]),
        ((None, None), [-300, 500], [0, 0]),
    ],
)
def test_the_turn_inside_the_limits_is_meant(limits, degrees, turns) -> None:
    arm = arm_of(limits, (None, None), (None, None))
    q = np.zeros((len(degrees), 3))
    q[:, 0] = np.radians(degrees)
    assert find_whole_turns(q, arm)[:, 0].tolist() == turns
    q[:, 0] = math.nan
    assert not find_whole_turns(q, arm).any()


def turned(session: Path, unit: float = math.tau) -> None:
    """As make.sh does: one turn more at joint 3."""
    path = session / "readings.csv"
    header, *rows = [line.split(",") for line in path.read_text().splitlines()]
    at = header.index("q3")
    for row in rows:
        row[at] = f"{float(row[at]) + unit:.12f}"
    path.write_text("\n".join(map(",".join, [header, *rows])) + "\n")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("turned")
    campaign = KINDS["diagnosis"](6, Noise())
    plants = [parse_plant("encoder_scale@joint 3=20")]
    campaign = plant_all(campaign, plants, np.random.default_rng([6, 0x9147]))
    write_campaign(folder, campaign, 6)
    return folder


@pytest.fixture(scope="module")
def both(folder: Path) -> tuple[list[Session], list[Session]]:
    """The sessions as they were, and with three of them a turn off."""
    arm = load_arm(folder / "arm.toml")
    paths = sorted(folder.glob("session-*"))
    before = load_sessions(paths, arm)
    for name in TURNED:
        turned(folder / name)
    return before, load_sessions(paths, arm)


def test_angles_are_folded_where_they_are_read_and_it_is_told(both) -> None:
    for before, after in zip(*both, strict=True):
        np.testing.assert_allclose(after.states.q, before.states.q, atol=2e-12)
        expected = 1 if after.name in TURNED else 0
        assert len(after.remarks) == expected
        assert not expected or f"{after.name}: q3" in after.remarks[0]


def test_without_limits_the_turn_is_left_and_reported(folder: Path, both) -> None:
    arm = load_arm(folder / "arm.toml")
    joints = list(arm.joint)
    joints[2] = joints[2].model_copy(update={"min_deg": None, "max_deg": None})
    free = arm.model_copy(update={"joint": joints})
    sessions = load_sessions(sorted(folder.glob("session-*")), free)
    told = [session.name for session in sessions if any("q3" in r for r in session.remarks)]
    assert told == list(TURNED)
    assert sessions[2].states.q[:, 2].min() > math.pi / 2


@pytest.mark.slow
def test_a_gain_stays_a_gain(folder: Path, both) -> None:
    """It was reported as an eccentricity, with 0.991, and an unknown."""
    diagnosis = diagnose(both[1], load_arm(folder / "arm.toml"))
    (found,) = diagnosis.findings
    assert found.candidate.place == ("encoder_scale", "joint 3")
    assert found.probability > 0.99

"""`armd arm`: the catalogue against the arms' own descriptions, and LeRobot's calibrations."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from urdf_numbers import DESCRIPTIONS, SO100, Description

from armd.arrays import F64
from armd.compensation.model.arm import load_arm
from armd.compensation.model.kinematics import compute_frames
from armd.daemon import cli
from armd.daemon.catalogue.known_arms import KNOWN, load_known_arm, read_arm_text
from armd.daemon.config import load_config
from armd.drivers.ports import list_serial_ports
from support.plain_kinematics import rotation, translation

LEROBOT: dict[str, dict[str, int]] = {
    name: dict(
        zip(("id", "drive_mode", "homing_offset", "range_min", "range_max"), row, strict=True)
    )
    for name, row in {
        "shoulder_pan": (1, 0, -1234, 747, 3456),
        "shoulder_lift": (2, 0, 981, 880, 3200),
        "elbow_flex": (3, 0, 12, 900, 3100),
        "wrist_flex": (4, 1, -3, 850, 3250),
        "wrist_roll": (5, 0, 77, 0, 4095),
        "gripper": (6, 0, 5, 2020, 3500),
    }.items()
}


def _quarter(angle: float) -> float:
    """*angle*, or the quarter turns that it was printed for, to five decimals."""
    turns = round(angle / (math.pi / 2)) * math.pi / 2
    return turns if abs(angle - turns) < 1.1e-5 else angle


def _chain(description: Description, q: F64, literal: bool) -> list[F64]:
    """The frame of every joint's child link in the file's base frame, mm."""
    frame, found = np.eye(4), []
    for joint, angle in zip(description.joints, q, strict=True):
        roll, pitch, yaw = joint.rpy if literal else map(_quarter, joint.rpy)
        (axis,) = np.flatnonzero(joint.axis)
        frame = frame @ translation(1000 * np.array(joint.xyz))
        frame = frame @ rotation(2, yaw) @ rotation(1, pitch) @ rotation(0, roll)
        frame = frame @ rotation(int(axis), angle * joint.axis[axis])
        found.append(frame)
    return found


def _written(name: str, folder: Path) -> Path:
    path = folder / "arm.toml"
    assert cli.main(["arm", name, "-o", str(path)]) == 0
    return path


@pytest.mark.parametrize("name", DESCRIPTIONS)
def test_the_geometry_is_the_descriptions(name: str, tmp_path: Path) -> None:
    description = DESCRIPTIONS[name]
    arm = load_arm(_written(name, tmp_path))
    rng = np.random.default_rng(7)
    q = rng.uniform(-np.pi, np.pi, (200, arm.n_joints))
    directions = [joint.direction for joint in arm.joint]
    assert directions == [joint.direction for joint in description.joints]
    origins, rotations = compute_frames(q * directions, arm.nominal())
    tips = origins[:, -1] + rotations[:, -1] @ np.array(arm.tip.offset_mm)
    for literal, tolerance_mm in ((False, 2e-9), (True, 5e-3)):
        for pose, tip_mm in zip(q, tips, strict=True):
            last = _chain(description, pose, literal)[-1]
            truth = (last @ [*(1000 * np.array(description.tip)), 1])[:3] - description.base_mm
            assert np.linalg.norm(truth - tip_mm) < tolerance_mm
    kg = [joint.mass_kg for joint in arm.joint]
    for k, link in enumerate(description.links):
        assert kg[k] == pytest.approx(link.mass_kg, abs=1e-6)
        for pose, origin, turned in zip(q[:5], origins, rotations, strict=False):
            frame = _chain(description, pose, False)[k]
            truth = (frame @ [*(1000 * np.array(link.centre)), 1])[:3] - description.base_mm
            centre = arm.joint[k].centre_of_mass_mm
            assert centre is not None
            found = origin[k + 1] + turned[k + 1] @ np.array(centre)
            assert np.linalg.norm(truth - found) < 1e-3
    for joint, said in zip(arm.joint, description.joints, strict=True):
        found_deg = (joint.min_deg, joint.max_deg)
        if said.limits is None:
            assert found_deg == (None, None)
        else:
            expected = sorted(math.degrees(joint.direction * limit) for limit in said.limits)
            assert found_deg == pytest.approx(expected, abs=0.006)


def test_the_so100_is_its_description_from_another_zero(tmp_path: Path) -> None:
    """Its joints turn as the description's from the pose where upper arm and forearm are square,
    which is that of the SO-101 within what the two drawings differ by."""
    arm = load_arm(_written("so100", tmp_path))
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, (100, 5))
    origins, _ = compute_frames(q, arm.nominal())
    quarter = np.pi / 2
    zero = np.array([0.0, 1.8, -quarter, 1 - quarter, 0.0])
    for pose, tip_mm in zip(q, origins[:, -1], strict=True):
        truth = _chain(SO100, pose + zero, False)[-1][:3, 3]
        here = rotation(2, -quarter)[:3, :3] @ tip_mm + [0.0, -45.2, 0.0]
        assert np.linalg.norm(truth - here) < 2e-9
    for k, (joint, said) in enumerate(zip(arm.joint, SO100.joints, strict=True)):
        assert said.limits is not None
        low, high = np.degrees(np.array(said.limits) - zero[k])
        assert (joint.min_deg, joint.max_deg) == pytest.approx((low, high), abs=0.001)
    other = load_arm(_written("so101", tmp_path / ".."))
    # Wrists at both zeros: the SO-101's drawing is 2.4 mm lower.
    wrists = [compute_frames(np.zeros((1, 5)), one.nominal())[0][0, 4] for one in (arm, other)]
    assert np.linalg.norm(wrists[0] - wrists[1]) < 3.0
    assert [one.direction for one in arm.joint] == [one.direction for one in other.joint]


@pytest.mark.parametrize("name", KNOWN)
def test_a_known_arm_is_valid_and_says_where_it_comes_from(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = _written(name, tmp_path)
    assert cli.main(["check", str(path)]) == 0
    text = path.read_text()
    assert "# Source: " in text and "Licence: " in text
    arm = load_arm(path)
    assert len(set(arm.sensors)) == arm.n_joints  # each link has a servo's temperature of its own
    assert all(joint.temperature == arm.sensors[k] for k, joint in enumerate(arm.joint))
    bus = KNOWN[name]
    if bus is not None:
        assert [f"servo{i}" for i in bus.temperature_ids] == arm.sensors
        assert all(joint.counts_per_turn == 4096 for joint in arm.joint)
        assert len(bus.ids) == arm.n_joints
    capsys.readouterr()
    assert cli.main(["arm", name]) == 0
    assert capsys.readouterr().out == text


def test_the_list_names_every_arm(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["arm", "list"]) == 0
    said = capsys.readouterr().out
    assert all(f"{name} " in said for name in [*KNOWN, "microscribe"])
    assert {*DESCRIPTIONS, "so100"} == set(KNOWN)  # which has a test of its own


def test_a_port_makes_an_armd_toml_and_none_is_written_over(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "arm.toml"
    command = ["arm", "SO101", "-o", str(path), "--serial-number", "MINE-1"]
    assert cli.main([*command, "--port", "/dev/ttyACM7"]) == 0
    assert load_arm(path).serial_number == "MINE-1"
    assert cli.main(["check", str(tmp_path / "armd.toml")]) == 0
    daemon = tomllib.loads((tmp_path / "armd.toml").read_text())
    assert daemon["arm"] == "arm.toml"
    assert daemon["driver"] == {
        "kind": "feetech",
        "port": "/dev/ttyACM7",
        "baud": 1_000_000,
        "ids": [1, 2, 3, 4, 5],
        "temperature_ids": [2, 3, 4, 5, 6],
    }
    (tmp_path / "armd.toml").write_text("mine\n")
    assert cli.main([*command, "--port", "/dev/ttyACM8"]) == 0
    assert (tmp_path / "armd.toml").read_text() == "mine\n"
    assert 'port = "/dev/ttyACM8"' in capsys.readouterr().out  # told, not written


def test_a_wrong_name_or_serial_number_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "arm.toml"
    assert cli.main(["arm", "so102", "-o", str(path)]) == 2
    assert "found 'so102', expected one of so101," in capsys.readouterr().err
    assert cli.main(["arm", "so101", "-o", str(path), "--serial-number", "two words"]) == 2
    assert "--serial-number: serial_number: found 'two words'" in capsys.readouterr().err
    assert not path.exists()


@pytest.mark.parametrize("name", ["SO-100", "so_100", "SO 100", "Gello YAM"])
def test_a_name_may_be_written_as_its_makers_write_it(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["arm", name]) == 0
    known = "gello-yam" if "YAM" in name else "so100"
    assert capsys.readouterr().out == read_arm_text(known)


def test_ports_have_their_lasting_names(tmp_path: Path) -> None:
    named = tmp_path / "serial/by-id"
    named.mkdir(parents=True)
    for device in ("ttyACM0", "ttyUSB3", "ttyS0"):
        (tmp_path / device).touch()
    (named / "usb-maker_adapter").symlink_to("../../ttyUSB3")
    assert list_serial_ports(tmp_path) == [tmp_path / "ttyACM0", named / "usb-maker_adapter"]


# --- LeRobot ---------------------------------------------------------------------------------


def _imported(folder: Path, motors: Mapping[str, object], *options: str) -> Path:
    """The arm.toml made of LeRobot's calibration."""
    source, path = folder / "calibration.json", folder / "arm.toml"
    source.write_text(json.dumps(motors))
    assert cli.main(["arm", "import-lerobot", str(source), "-o", str(path), *options]) == 0
    return path


def _driver(folder: Path, motors: Mapping[str, object], *options: str) -> dict[str, list[int]]:
    """[driver] of the armd.toml made beside it."""
    _imported(folder, motors, "--port", "/dev/ttyACM0", "--force", *options)
    driver: dict[str, list[int]] = tomllib.loads((folder / "armd.toml").read_text())["driver"]
    return driver


def test_lerobots_degrees_and_ours_are_the_same_pose(tmp_path: Path) -> None:
    """A raw position, by LeRobot's arithmetic and the drawing, and by the arm.toml made of it."""
    path = _imported(tmp_path, LEROBOT)
    arm = load_arm(path)
    drawing = load_arm(_written("so101", tmp_path / ".."))
    for k, (motor, joint, nominal) in enumerate(
        zip(LEROBOT.values(), arm.joint, drawing.joint, strict=False)
    ):
        low, high = motor["range_min"], motor["range_max"]
        sign = nominal.direction * (-1 if motor["drive_mode"] else 1)
        for raw in (low, (low + high) // 2, high):
            lerobot_deg = (raw - (low + high) / 2) * 360 / 4095 * 4095 / 4096  # its scale mended
            ours_deg = joint.direction * (raw - 2048) * 360 / 4096
            assert ours_deg + joint.theta_deg == pytest.approx(
                sign * lerobot_deg + nominal.theta_deg, abs=1e-9
            ), k
            assert joint.min_deg is not None and joint.max_deg is not None
            assert joint.min_deg - 0.001 <= ours_deg <= joint.max_deg + 0.001
    assert arm.joint[3].direction == -1  # drive_mode 1
    assert [j.temperature for j in arm.joint] == [j.temperature for j in drawing.joint]
    assert "1: -1234, 2: 981, 3: 12, 4: -3, 5: 77, 6: 5" in path.read_text()


def test_a_dynamixel_turns_its_count_round_itself(tmp_path: Path) -> None:
    """LeRobot's Koch leader: Drive_Mode 1 is written to the elbow's servo, and not applied again
    (`DynamixelMotorsBus.apply_drive_mode`)."""
    leader = {
        key: {**motor, "drive_mode": int(key == "elbow_flex")} for key, motor in LEROBOT.items()
    }
    drawing = load_known_arm("koch")
    path = _imported(tmp_path, leader, "--arm", "koch")
    taken = [joint.direction for joint in load_arm(path).joint]
    assert taken == [joint.direction for joint in drawing.joint]


def test_lerobots_ids_are_taken_over(tmp_path: Path) -> None:
    renamed = {key: {**motor, "id": motor["id"] + 10} for key, motor in LEROBOT.items()}
    driver = _driver(tmp_path, renamed)
    assert driver["ids"] == [11, 12, 13, 14, 15]
    assert driver["temperature_ids"] == [12, 13, 14, 15, 16]


def test_servos_whose_ids_are_swapped_keep_their_joints(tmp_path: Path) -> None:
    """A joint is the one of its name: by ids, the elbow's zero and limits became the wrist's."""
    joints = load_arm(_imported(tmp_path, LEROBOT)).joint
    swapped = {"elbow_flex": 4, "wrist_flex": 3, "gripper": 7}
    content = {
        key: {**motor, "id": swapped.get(key, motor["id"])} for key, motor in LEROBOT.items()
    }
    driver = _driver(tmp_path, dict(sorted(content.items())))
    assert load_arm(tmp_path / "arm.toml").joint == joints
    assert driver["ids"] == [1, 2, 4, 3, 5]
    assert driver["temperature_ids"] == [2, 4, 3, 5, 7]


def test_without_a_gripper_no_servo_is_asked_that_is_not_there(tmp_path: Path) -> None:
    driver = _driver(tmp_path, {key: LEROBOT[key] for key in LEROBOT if key != "gripper"})
    assert driver["temperature_ids"] == [2, 3, 4, 5, 5]
    load_config(tmp_path / "armd.toml")  # one servo may be the warmth of two links


def test_an_arm_on_wheels_is_the_arm_without_them(tmp_path: Path) -> None:
    """LeKiwi keeps one file for its SO-101 and its three wheels (`LeKiwi` in LeRobot's
    robots/lekiwi)."""
    path = _imported(tmp_path, LEROBOT)
    alone = path.read_text()
    wheel = {"drive_mode": 0, "homing_offset": 0, "range_min": 0, "range_max": 4095}
    wheels = {f"base_{side}_wheel": {"id": k, **wheel} for k, side in enumerate("abc", 7)}
    arm = {f"arm_{key}": motor for key, motor in LEROBOT.items()}
    driver = _driver(tmp_path, arm | wheels)
    assert path.read_text() == alone
    assert driver["ids"] == [1, 2, 3, 4, 5] and driver["temperature_ids"] == [2, 3, 4, 5, 6]


def test_the_second_servo_of_a_joint_is_not_read(tmp_path: Path) -> None:
    """A ViperX: shoulder and elbow have two servos each."""
    names = ["waist", "shoulder", "shoulder_shadow", "elbow", "elbow_shadow", "forearm_roll"]
    names += ["wrist_angle", "wrist_rotate", "gripper"]
    motor = {"drive_mode": 0, "homing_offset": 70_000, "range_min": 900, "range_max": 3200}
    motors = {key: {"id": k, **motor} for k, key in enumerate(names, 1)}
    driver = _driver(tmp_path, motors, "--arm", "vx300s")
    assert driver["ids"] == [1, 2, 4, 6, 7, 8]
    assert driver["temperature_ids"] == [2, 4, 6, 7, 8, 9]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"elbow_flex": None}, "motors of joints: found 4 (shoulder_pan, shoulder_lift, "),
        ({"elbow_flex": {"id": 2}}, "id: found 1, 2, 2, 4, 5, 6, expected ids that differ"),
        ({"elbow_flex": {"range_max": 4096}}, "elbow_flex.range_max: found 4096, expected less"),
        ({"elbow_flex": {"range_min": 3100}}, "elbow_flex.range_min: found 3100, expected less"),
        ({"elbow_flex": {"homing_offset": "x"}}, "elbow_flex.homing_offset: found 'x'"),
        ({"gripper": {"homing_offset": -2048}}, "gripper.homing_offset: found -2048, expected -2"),
        (
            {"elbow_flex": {"range_min": 2000, "range_max": 2003}},
            "elbow_flex.range_max - elbow_flex.range_min: found 3 counts, expected a sweep of 141",
        ),
    ],
)
def test_what_is_no_calibration_of_this_arm_is_refused(
    change: dict[str, dict[str, object] | None],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    content: dict[str, object] = dict(LEROBOT)
    for key, values in change.items():
        if values is None:
            del content[key]
        else:
            content[key] = LEROBOT[key] | values
    source, path = tmp_path / "follower.json", tmp_path / "arm.toml"
    source.write_text(json.dumps(content))
    assert cli.main(["arm", "import-lerobot", str(source), "-o", str(path)]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"armd: {source}: ") and said in error
    assert not path.exists()

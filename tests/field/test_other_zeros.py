"""Angles as phosphobot and GELLO record them, through `armd import --servo-zeros`."""

from __future__ import annotations

import base64
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session, load_session
from armd.compensation.model.arm import load_arm
from armd.daemon.catalogue.known_arms import read_arm_text
from armd.daemon.cli import main
from support.robot_logs import dataset

FIELD = Path(__file__).parent
PHOSPHOBOT = FIELD / "lerobot-other-files" / "phosphobot.json"
GELLO = FIELD / "gello" / "yam.yaml"
#: Raw positions of the servos, two instants; the gripper is the sixth.
RAW = np.array([[2048, 1500, 2900, 2066, 100, 2500], [2049, 1501, 2899, 2066, 101, 2600]])


def phosphobots_angles(raw: np.ndarray) -> np.ndarray:
    """As its manipulators compute them."""
    config = json.loads(PHOSPHOBOT.read_text())
    offsets, signs = (np.array(config[f"servos_offsets{key}"]) for key in ("", "_signs"))
    angles: np.ndarray = (raw - offsets) * signs * (2 * np.pi / 4095)
    return angles


def as_written(row: np.ndarray, how: str) -> Any:
    if how == "list":
        return row.tolist()
    if how == "base64":
        content = base64.b64encode(row.tobytes()).decode()
        return {"__numpy__": content, "dtype": str(row.dtype), "shape": list(row.shape)}
    return {"_type": "ndarray", "data": row.tolist(), "dtype": "float64", "shape": list(row.shape)}


def episode(path: Path, how: str = "ndarray", **changes: Any) -> Path:
    """The vendored one with its arrays written so, and *changes*."""
    content = json.loads((FIELD / "phosphobot" / "episode.json").read_text())
    for step in content["steps"]:
        joints = np.array(step["observation"]["joints_position"]["data"])
        step["observation"]["joints_position"] = as_written(joints, how)
    path.write_text(json.dumps(content | changes))
    return path


def imported(source: Path, out: Path, *options: object, arm: str = "so100") -> int:
    arm_path = out.parent / "arm.toml"
    arm_path.write_text(read_arm_text(arm), encoding="utf-8")
    words = ["import", str(source), "--arm", str(arm_path), "-o", str(out), "-q"]
    return main([*words, *map(str, options)])


def session(out: Path) -> Session:
    return load_session(out, load_arm(out.parent / "arm.toml"))


def assert_counts(out: Path, expected: np.ndarray, within: float = 1e-6) -> None:
    """The session's angles (n, N) are those of *expected* counts from the middle."""
    arm = load_arm(out.parent / "arm.toml")
    directions = [joint.direction for joint in arm.joint]
    turn = session(out).states.q * directions / math.tau * 4096
    assert np.abs(turn - expected).max() < within


@pytest.mark.parametrize("how", ["ndarray", "list", "base64"])
def test_an_episode_of_phosphobot(how: str, tmp_path: Path) -> None:
    source = episode(tmp_path / "episode_2026-03-01_09-00-00.json", how)
    assert imported(source, tmp_path / "s", "--servo-zeros", PHOSPHOBOT) == 0
    assert_counts(tmp_path / "s", RAW[:, :5] - 2048)
    measured = session(tmp_path / "s")
    assert np.diff(measured.states.time_s) == pytest.approx(1 / 30, abs=1e-6)
    assert "2026-03-01" in (tmp_path / "s" / "session.toml").read_text()


def test_an_episode_without_its_calibration_stays_in_radians(tmp_path: Path) -> None:
    assert imported(episode(tmp_path / "e.json"), tmp_path / "s") == 0
    expected = phosphobots_angles(RAW)[:, :5]
    assert session(tmp_path / "s").states.q == pytest.approx(expected, abs=1e-12)


def test_a_data_set_of_phosphobot(tmp_path: Path) -> None:
    """LeRobot's form, with the servos' ids as names and radians in float32."""
    names = [f"motor_{k}" for k in range(1, 7)]
    folder = dataset(tmp_path / "set", names, [phosphobots_angles(RAW)], per_file=True)
    assert imported(folder, tmp_path / "s", "--servo-zeros", PHOSPHOBOT) == 0
    assert_counts(tmp_path / "s", RAW[:, :5] - 2048, within=1e-3)


def test_angles_of_a_gello(tmp_path: Path) -> None:
    raw = np.array([[2000.0, 3100, 4200, 1000, 5000, 2040], [2010, 3110, 4210, 1010, 5010, 2050]])
    offsets = [3.14159, 4.71239, 6.28319, 1.5708, 7.85398, 3.14159]
    angles = (raw * np.pi / 2048 - offsets) * [1, -1, -1, -1, 1, 1]
    lines = [",".join(f"joint_{k}" for k in range(6))]
    lines += [",".join(map(repr, row)) for row in angles.tolist()]
    (tmp_path / "log.csv").write_text("\n".join(lines) + "\n")
    block = GELLO.read_text().replace("joint_signs: [1.0, -1, -1.0, -1, 1, 1]", "joint_signs:")
    signs = "".join(f"\n      - {sign}" for sign in (1.0, -1, -1.0, -1, 1, 1))
    (tmp_path / "block.yml").write_text(block.replace("joint_signs:", "joint_signs:" + signs))
    folded = raw - 2048 - [0, 0, 4096, 0, 4096, 0]  # the turn of the first reading
    for name in (GELLO, tmp_path / "block.yml"):
        out = tmp_path / name.stem
        assert imported(tmp_path / "log.csv", out, "--servo-zeros", name, arm="gello-yam") == 0
        assert_counts(out, folded)


BAD_EPISODES: dict[str, tuple[Any, str]] = {
    "no steps": ({"steps": []}, "the file: found another kind of JSON"),
    "no observation": ({"steps": [{"action": 1}]}, "steps[0]: found {'action': 1}"),
    "no joints": (
        {"steps": [{"observation": {"timestamp": 0.0}}]},
        "steps[0].observation.joints_position: found None",
    ),
    "words": (
        {"steps": [{"observation": {"timestamp": 0.0, "joints_position": ["a"]}}]},
        "joints_position: found ['a']",
    ),
    "spoilt base64": (
        {"steps": [{"observation": {"timestamp": 0.0, "joints_position": {
            "__numpy__": "###", "dtype": "float64", "shape": [6]}}}]},
        "joints_position: found {'__numpy__'",
    ),
    "no time": (
        {"steps": [{"observation": {"joints_position": [0.0] * 6}}]},
        "steps[0].observation.timestamp: found None",
    ),
    "endless time": (
        {"steps": [{"observation": {"joints_position": [0.0] * 6, "timestamp": 10**400}}]},
        "steps[0].observation.timestamp: found 1000",
    ),
    "fewer joints": (
        {"steps": [{"observation": {"joints_position": [0.0] * n, "timestamp": 0.0}}
                   for n in (6, 5)]},
        "steps[1].observation.joints_position: found 5 joints, expected 6, as before",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_EPISODES)
def test_what_is_no_episode(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    changes, said = BAD_EPISODES[name]
    assert imported(episode(tmp_path / "e.json", **changes), tmp_path / "s") == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and said in told and not (tmp_path / "s").exists()


CONFIG = json.loads(PHOSPHOBOT.read_text())
BAD_ZEROS: dict[str, tuple[str, str, str]] = {
    "other JSON": ("z.json", "{}", "the file: found another kind of JSON"),
    "an arm without counts": (
        "z.json", json.dumps(CONFIG | {"name": "agilex-piper"}), "name: found 'agilex-piper'",
    ),
    "a word": (
        "z.json", json.dumps(CONFIG | {"servos_offsets": [1, "x"]}), "servos_offsets[1]: found 'x'",
    ),
    "too few": (
        "z.json",
        json.dumps(CONFIG | {"servos_offsets": [1.0], "servos_offsets_signs": [1.0]}),
        "the offsets: found 1 joints, expected 5",
    ),
    "endless": (
        "z.json", json.dumps(CONFIG | {"servos_offsets": [10**400] * 6}),
        "servos_offsets[0]: found an endless number",
    ),
    "far off": (
        "z.json", json.dumps(CONFIG | {"servos_offsets": [1e300] * 6}),
        "servos_offsets[0]: found 1e+300 counts",
    ),
    "no signs": (
        "z.yaml", "joint_offsets: [1, 2, 3, 4, 5]\n", "joint_signs: found nothing",
    ),
    "signs of half": (
        "z.yaml", "joint_offsets: [1, 2]\njoint_signs: [1, 0.5]\n", "joint_signs[1]: found 0.5",
    ),
    "a list without end": (
        "z.yaml", "joint_offsets: [1, 2\n", "joint_offsets: found a list without its end",
    ),
    "twice": (
        "z.yaml", "joint_offsets: [1]\nb:\n  joint_offsets: [1]\n",
        "joint_offsets: found it 2 times",
    ),
    "an expression": (
        "z.yaml", "joint_offsets: [np.pi, 2]\n", "joint_offsets[0]: found 'np.pi'",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_ZEROS)
def test_what_are_no_zeros(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, content, said = BAD_ZEROS[name]
    (tmp_path / file).write_text(content)
    source = episode(tmp_path / "e.json")
    assert imported(source, tmp_path / "s", "--servo-zeros", tmp_path / file) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and said in told and not (tmp_path / "s").exists()

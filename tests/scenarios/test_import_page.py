"""The blocks of docs/how-to/import.md run as they stand, on files of other programs."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import openpyxl
from rosbags.rosbag2 import StoragePlugin

from armd.compensation.data.sessions.session import load_session
from armd.compensation.model.arm import load_arm
from support.pages import page_path, run_as_typed, shell_blocks
from support.robot_logs import MOTORS, bag, dataset

FIELD = Path(__file__).parents[1] / "field"
FOLLOWER = FIELD / "lerobot-wrapped-sweep" / "whole.json"
PAGE = page_path("import")
ROBOT = """<robot name="three">
{links}
{joints}
</robot>
"""


def workbook(path: Path) -> None:
    book = openpyxl.Workbook()
    book.active.append(["notes"])
    sheet = book.create_sheet("Data")
    sheet.append(["Ball", "Base axis", *(f"Joint {k}" for k in range(2, 6))])
    sheet.append(["left", 12.5, -40.25, 61.75, 10.0, 0.5])
    book.save(path)


def robot() -> str:
    """Three joints in a row."""
    links = "".join(f'<link name="l{k}"/>' for k in range(4))
    joints = "".join(
        f'<joint name="j{k}" type="revolute"><parent link="l{k}"/><child link="l{k + 1}"/>'
        f'<origin xyz="{0.1 * k} 0 0.2"/><axis xyz="0 {k % 2} {1 - k % 2}"/>'
        '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
        for k in range(3)
    )
    return ROBOT.format(links=links, joints=joints)


def test_the_page_runs_from_an_empty_folder(tmp_path: Path) -> None:
    workbook(tmp_path / "readings.xlsx")
    (tmp_path / "robot.urdf").write_text(robot())
    shutil.copy(FOLLOWER, tmp_path / "follower.json")
    dataset(tmp_path / "my-dataset", MOTORS, [np.zeros((4, 6))], per_file=True)
    bag(tmp_path / "rosbag2_2026_03_01", StoragePlugin.MCAP)
    shutil.copy(FIELD / "phosphobot" / "episode.json", tmp_path / "episode.json")
    zeros = FIELD / "lerobot-other-files" / "phosphobot.json"
    shutil.copy(zeros, tmp_path / "so-100_config.json")
    text = PAGE.read_text(encoding="utf-8")
    said = run_as_typed("".join(shell_blocks(text)), tmp_path).splitlines()
    outputs = re.findall(r"```\n(armd: .*?)```", text, re.DOTALL)
    assert len(outputs) == 2
    lines = [line for output in outputs for line in output.splitlines() if line != "…"]
    assert [line for line in lines if line not in said] == []
    arm = load_arm(tmp_path / "my-arm" / "arm.toml")
    assert load_session(tmp_path / "measured", arm).n == 3
    assert load_session(tmp_path / "from-excel", arm).n == 1
    assert load_session(tmp_path / "from-lerobot", arm).n == 4
    assert load_session(tmp_path / "from-ros", arm).n == 3
    so100 = load_arm(tmp_path / "so100.toml")
    assert load_session(tmp_path / "from-phosphobot", so100).n == 2
    tracked = load_session(tmp_path / "tracked", arm)
    assert tracked.n == 3 and tracked.truth_mm[1].tolist() == [794.520, 12.404, 241.337]
    drawn = load_arm(tmp_path / "drawn-arm" / "arm.toml")
    assert [joint.d_mm for joint in drawn.joint] == [292.1, 0.0, 0.0]
    assert drawn.sensors == ["foot", "elbow"]
    assert load_arm(tmp_path / "arm.toml").n_joints == 3

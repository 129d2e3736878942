"""What robots record: LeRobot data sets and ROS 2 bags, through `armd import`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
import pytest
from rosbags.rosbag2 import StoragePlugin

from armd.compensation.data.foreign.rosbag import SUFFIXES, read_bag
from armd.compensation.data.sessions.session import Session, load_session
from armd.compensation.model.arm import load_arm
from armd.daemon.cli import main
from armd.errors import BadInput
from support.robot_logs import MOTORS, bag, dataset

FIELD = Path(__file__).parent
LEROBOT = FIELD / "lerobot-normalised"
WHOLE = FIELD / "lerobot-wrapped-sweep" / "whole.json"
POSE = [-82.870, -52.638, 60.255, 16.432, -81.174, 40.0]


def imported(source: Path, out: Path, *options: str) -> int:
    arm = str(LEROBOT / "arm.toml")
    return main(["import", str(source), "--arm", arm, "-o", str(out), *options])


def session(out: Path) -> Session:
    return load_session(out, load_arm(LEROBOT / "arm.toml"))


@pytest.mark.parametrize("per_file", [True, False])
@pytest.mark.parametrize("names", [[f"{m}.pos" for m in MOTORS], {"motors": MOTORS}])
def test_a_data_set_of_lerobot(
    names: Any, per_file: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """-100…100 of 2642 counts are ±116.10°, of 2209 ±97.08°; two episodes of 3 frames."""
    states = [np.array([POSE, POSE, POSE]), np.array([POSE, POSE, POSE]) * 0.5]
    folder = dataset(tmp_path / "set", names, states, per_file=per_file)
    assert imported(folder, tmp_path / "s", "--lerobot", str(WHOLE)) == 0
    said = capsys.readouterr().out
    assert "actions are left out" in said and "2 episodes stand one after another" in said
    measured = session(tmp_path / "s")
    first, last = np.degrees(measured.states.q[[0, 5]])
    assert first[0] == pytest.approx(-0.8287 * 2642 / 2 * 360 / 4096, rel=1e-6)
    assert last[2] == pytest.approx(0.5 * 0.60255 * 2209 / 2 * 360 / 4096, rel=1e-6)
    seconds = measured.states.time_s - measured.states.time_s[0]
    assert seconds == pytest.approx(np.arange(6) / 30, abs=1e-6)
    (one, *_) = sorted((folder / "data").rglob("*.parquet"))
    assert imported(one, tmp_path / "one", "--lerobot", str(WHOLE)) == 0
    assert session(tmp_path / "one").n == (3 if per_file else 6)


def test_one_arm_of_two(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    names = [f"{side}_{motor}.pos" for side in ("left", "right") for motor in MOTORS]
    states = [np.array([[*(np.array(POSE) * 0.25), *POSE]] * 2)]
    folder = dataset(tmp_path / "set", names, states, per_file=True)
    both = {f"{side}_{k}": v for side in ("left", "right")
            for k, v in json.loads(WHOLE.read_text()).items()}  # fmt: skip
    (tmp_path / "both.json").write_text(json.dumps(both))
    for calibration in (WHOLE, tmp_path / "both.json"):
        for prefix, share in (("left", 0.25), ("right_", 1.0)):
            out = tmp_path / f"{calibration.stem}-{prefix}"
            words = ["--prefix", prefix, "--lerobot", str(calibration), "-q"]
            assert imported(folder, out, *words) == 0
            pan = np.degrees(session(out).states.q[0, 0])
            assert pan == pytest.approx(-0.8287 * share * 2642 / 2 * 360 / 4096, rel=1e-6)
    assert imported(folder, tmp_path / "x", "--lerobot", str(WHOLE)) == 2
    assert "or --prefix NAME for one arm of several" in capsys.readouterr().err
    assert imported(folder, tmp_path / "x", "--prefix", "middle_", "--lerobot", str(WHOLE)) == 2
    assert "--prefix: found 'middle_'" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()


def damaged(folder: Path, how: str) -> Path:
    made = dataset(folder / "set", MOTORS, [np.array([POSE])], per_file=True)
    (file,) = (made / "data").rglob("*.parquet")
    if how == "no parquet":
        file.write_text("no")
    elif how == "no info":
        (made / "meta" / "info.json").unlink()
        return file
    elif how == "names":
        info = json.loads((made / "meta" / "info.json").read_text())
        info["features"]["observation.state"]["names"] = MOTORS[:4]
        (made / "meta" / "info.json").write_text(json.dumps(info))
    elif how == "columns":
        pa.parquet.write_table(pa.table({"x": [1.0]}), file)
    elif how == "empty":
        file.unlink()
    return made


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ("no parquet", "expected a parquet file"),
        ("no info", "no meta/info.json in a folder above it"),
        ("names", "expected 6 names"),
        ("columns", "observation.state: found no such column among x"),
        ("empty", "found no *.parquet"),
    ],
)
def test_what_is_no_data_set(
    how: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert imported(damaged(tmp_path, how), tmp_path / "s", "--lerobot", str(WHOLE)) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


# --- ROS 2 ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("whole", [True, False])
def test_a_bag_of_ros(
    plugin: StoragePlugin, whole: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = bag(tmp_path / "bag", plugin)
    (file,) = [p for p in folder.iterdir() if p.suffix in (".mcap", ".db3")]
    assert imported(folder if whole else file, tmp_path / "s") == 0
    assert "3 messages of /joint_states" in capsys.readouterr().out
    measured = session(tmp_path / "s")
    assert measured.states.q[0] == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])
    assert measured.states.q[1] == pytest.approx([0.51, 0.41, 0.31, 0.21, 0.11])
    assert measured.states.time_s == pytest.approx(1_772_000_000 + np.arange(3), abs=1e-5)


def test_what_is_no_bag_of_joint_states(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    two = bag(tmp_path / "two", StoragePlugin.MCAP, ("/a/joint_states", "/b/joint_states"))
    assert imported(two, tmp_path / "s") == 2
    assert "found /a/joint_states, /b/joint_states, expected one topic" in capsys.readouterr().err
    for suffix in (".mcap", ".db3"):
        torn = tmp_path / f"torn{suffix}"
        torn.write_bytes(b"\x89MCAP0\r\n no more")
        assert imported(torn, tmp_path / "s") == 2
        assert f"torn{suffix}: the file: found no" in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize("plugin", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_damaged_bag_is_refused_or_read(plugin: StoragePlugin, tmp_path: Path) -> None:
    """Bytes changed anywhere: an answer in words, whatever a length says then."""
    (file,) = [p for p in bag(tmp_path / "bag", plugin).iterdir() if p.suffix in SUFFIXES]
    whole, rng = file.read_bytes(), np.random.default_rng(1)
    refused = 0
    for _ in range(60):
        data = bytearray(whole)
        for at in rng.integers(len(data), size=4):
            data[at] = rng.integers(256)
        file.write_bytes(data)
        try:
            read_bag(file)
        except BadInput:
            refused += 1
    assert refused > 5

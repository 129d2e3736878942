"""Twelve and twenty joints, offline: the truth is a chain of 4 × 4 matrices in plain numpy."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from armd.daemon import cli
from support.plain_kinematics import tip_pose
from support.plain_urdf import tip_poses
from support.selection import parametrize_default

NOISE_MM = 0.002
TIP_MM = [10.0, 20.0, 80.0]


def row_of(k: int) -> tuple[float, float, float]:
    """d, a in mm and alpha in degrees of joint k, from 0, as drawn."""
    return (120.0, 0.0, 40.0)[k % 3], (0.0, 60.0, 25.0)[k % 3], 90.0 if k % 2 else -90.0


def drawn_parameters(n: int) -> np.ndarray:
    """(5 n + 9,) as `support.plain_kinematics` has them."""
    rows = [(0.0, d, a, math.radians(alpha), 0.0) for d, a, alpha in map(row_of, range(n))]
    return np.concatenate([*rows, TIP_MM, np.zeros(6)])


class Chain:
    """An arm as drawn and as made, in *folder*."""

    def __init__(self, folder: Path, n: int) -> None:
        self.n, self.folder = n, folder
        self.rng = rng = np.random.default_rng(n)
        made = np.zeros((n, 5))
        made[:, :4] = rng.uniform(-1.0, 1.0, (n, 4)) * [0.005, 0.3, 0.3, 0.005]
        self.made = drawn_parameters(n)
        self.made[: 5 * n] += made.ravel()
        text = 'schema = "armd.arm/1"\nserial_number = "LONG"\n'
        for d, a, alpha in map(row_of, range(n)):
            text += f"[[joint]]\nd_mm = {d}\na_mm = {a}\nalpha_deg = {alpha}\n"
            text += "min_deg = -150.0\nmax_deg = 150.0\n"
        (folder / "arm.toml").write_text(text + f"[tip]\noffset_mm = {TIP_MM}\n")
        self.arm = str(folder / "arm.toml")

    def postures(self, count: int) -> np.ndarray:
        return self.rng.uniform(-2.5, 2.5, (count, self.n))

    def tips(self, q: np.ndarray) -> np.ndarray:
        return tip_pose(q, np.tile(self.made, (len(q), 1)))[:, :3, 3]

    def table(self, name: str, q: np.ndarray, points: np.ndarray | None = None) -> Path:
        columns = [f"q{k}" for k in range(1, self.n + 1)]
        columns += ["x_mm", "y_mm", "z_mm"] if points is not None else []
        values = q if points is None else np.column_stack([q, points])
        path = self.folder / name
        lines = [",".join(columns), *(",".join(map(repr, row)) for row in values.tolist())]
        path.write_text("\n".join(lines) + "\n")
        return path

    def session(self, name: str, count: int) -> str:
        """A tracker follows the tip, by `armd import`."""
        q = self.postures(count)
        points = self.tips(q) + NOISE_MM * self.rng.normal(size=(count, 3))
        path = self.table(f"{name}.csv", q, points)
        out = str(self.folder / name)
        words = ["import", str(path), "--arm", self.arm, "--angle-unit", "rad", "-o", out, "-q"]
        assert cli.main(words) == 0
        return out


@parametrize_default("n", [12, 20])
def test_all_offline_commands(n: int, tmp_path: Path) -> None:
    chain = Chain(tmp_path, n)
    measured = chain.session("measured", 25 * n)
    fresh = chain.session("fresh", 60)
    cal, out = str(tmp_path / "cal.json"), tmp_path / "out.json"
    assert cli.main(["check", chain.arm, measured]) == 0
    assert cli.main(["calibrate", measured, "--arm", chain.arm, "-o", cal, "-q"]) == 0
    with_cal = ["--arm", chain.arm, "--calibration", cal]
    assert cli.main(["evaluate", fresh, *with_cal, "--json", str(out), "-q"]) == 0
    assert json.loads(out.read_text())["rms_um"] < 1.5 * 1e3 * NOISE_MM * math.sqrt(3)
    # Points of the real arm from its angles, but for where a tracker's frame stands.
    q = chain.postures(40)
    points = tmp_path / "points.csv"
    readings = str(chain.table("q.csv", q))
    assert cli.main(["correct", readings, *with_cal, "-o", str(points), "-q"]) == 0
    with points.open() as file:
        seen = np.array([[float(r[f"{a}_mm"]) for a in "xyz"] for r in csv.DictReader(file)])
    wanted = chain.tips(q)
    u, _, v = np.linalg.svd((seen - seen.mean(axis=0)).T @ (wanted - wanted.mean(axis=0)))
    off = (seen - seen.mean(axis=0)) @ (u @ v) - (wanted - wanted.mean(axis=0))
    assert np.sqrt((off**2).sum(axis=1).mean()) < 2 * NOISE_MM


@pytest.mark.slow
@pytest.mark.parametrize("n", [12, 20])
def test_a_disc_off_its_axis_is_found(n: int, tmp_path: Path) -> None:
    """1e-3 rad in joint 11, whose number has two digits."""
    chain = Chain(tmp_path, n)
    q = chain.postures(25 * n)
    real = q.copy()
    real[:, 10] += 1e-3 * np.sin(q[:, 10])
    points = chain.tips(real) + NOISE_MM * chain.rng.normal(size=(len(q), 3))
    path = chain.table("disc.csv", q, points)
    words = ["import", str(path), "--arm", chain.arm, "--angle-unit", "rad", "-q"]
    assert cli.main([*words, "-o", str(tmp_path / "disc")]) == 0
    out, better = tmp_path / "d.json", tmp_path / "better.json"
    words = [str(tmp_path / "disc"), "--arm", chain.arm, "--json", str(out), "-q"]
    assert cli.main(["diagnose", *words, "--extended", str(better)]) == 0
    findings = json.loads(out.read_text())["findings"]
    assert ("encoder_eccentricity", "joint 11") in [(f["cause"], f["location"]) for f in findings]
    words = [str(tmp_path / "disc"), "--arm", chain.arm, "--calibration", str(better)]
    assert cli.main(["evaluate", *words, "--json", str(out), "-q"]) == 0
    assert json.loads(out.read_text())["rms_um"] < 1.2 * 1e3 * NOISE_MM * math.sqrt(3)


@parametrize_default("n", [12, 20])
def test_the_urdf_of_a_long_chain(n: int, tmp_path: Path) -> None:
    """Written by `armd model`, walked by numpy, and imported again."""
    chain = Chain(tmp_path, n)
    urdf = tmp_path / "arm.urdf"
    assert cli.main(["model", chain.arm, "-o", str(urdf)]) == 0
    again = tmp_path / "again.toml"
    assert cli.main(["import", str(urdf), "-o", str(again), "-q"]) == 0
    assert again.read_text().count("[[joint]]") == n
    robot = ElementTree.parse(urdf).getroot()
    assert sum(joint.get("type") == "revolute" for joint in robot.findall("joint")) == n
    q = chain.postures(20)
    expected = tip_pose(q, np.tile(drawn_parameters(n), (len(q), 1)))
    found = tip_poses(robot, q, "LONG_ball")
    assert found[:, :3, 3] == pytest.approx(expected[:, :3, 3], abs=1e-6)


def test_more_are_refused_and_the_daemon_says_its_limit(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    chain = Chain(tmp_path, 21)
    assert cli.main(["check", chain.arm]) != 0
    assert "joint: found 21 entries, expected at most 20" in capsys.readouterr().err
    Chain(tmp_path, 12)
    text = (tmp_path / "arm.toml").read_text()
    text = text.replace("[[joint]]", "[[joint]]\ncounts_per_turn = 4096")
    (tmp_path / "arm.toml").write_text(text)
    (tmp_path / "armd.toml").write_text(
        'schema = "armd.daemon/1"\narm = "arm.toml"\n[driver]\nkind = "serial"\nport = "none"\n'
    )
    assert cli.main(["run", str(tmp_path / "armd.toml")]) == 2
    assert "joint: found 12 of them, expected 3 to 9 of a live arm" in capsys.readouterr().err

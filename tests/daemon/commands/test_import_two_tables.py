"""`armd import --points`: joints in one table, a tracker's points in another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armd.compensation.data.foreign.join_tables import join_tables
from armd.compensation.data.foreign.table import ForeignTable
from armd.compensation.data.sessions.session import Session, load_session
from armd.compensation.model.arm import load_arm
from armd.daemon.cli import main

ARM = 'schema = "armd.arm/1"\nserial_number = "A-1"\n' + 3 * "[[joint]]\na_mm = 300.0\n"


class Bench:
    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.folder, self.capsys = folder, capsys
        (folder / "arm.toml").write_text(ARM, encoding="utf-8")

    def run(self, joints: str, points: str, *options: str) -> tuple[int, str]:
        for name, text in (("joints.csv", joints), ("points.csv", points)):
            (self.folder / name).write_text(text, encoding="utf-8")
        words = [
            str(self.folder / name) for name in ("joints.csv", "points.csv", "out", "arm.toml")
        ]
        code = main(
            ["import", words[0], "--points", words[1], "-o", words[2], "--arm", words[3], *options]
        )
        told = self.capsys.readouterr()
        return code, told.out + told.err

    def session(self) -> Session:
        return load_session(self.folder / "out", load_arm(self.folder / "arm.toml"))

    @property
    def written(self) -> bool:
        return (self.folder / "out").exists()


@pytest.fixture
def bench(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Bench:
    return Bench(tmp_path, capsys)


JOINTS = (
    "time_s,q1_deg,q2_deg,q3_deg\n0.0,10,20,30\n0.1,10,20,30\n5.0,11,21,31\n5.1,12,22,32\n9,0,0,0\n"
)


def test_each_point_takes_the_joints_nearest_in_time(bench: Bench) -> None:
    points = "t [ms],X,Y,Z\n5080,4,5,6\n20,1,2,3\n9000,7,8,9\n"  # in any order, in ms
    code, told = bench.run(JOINTS, points)
    assert code == 0, told
    assert "joined with points.csv by time, at most 0.02 s apart; 2 rows of joints" in told
    session = bench.session()
    assert np.degrees(session.states.q[:, 0]).tolist() == pytest.approx([12.0, 10.0, 0.0])
    assert session.truth_mm.tolist() == [[4, 5, 6], [1, 2, 3], [7, 8, 9]]


def test_the_trackers_reflectors_come_along(bench: Bench) -> None:
    joints = "q1,q2,q3\n0.1,0,0\n0.2,0,0\n"
    code, told = bench.run(joints, "Reflector,x,y,z\nA,1,2,3\nB,4,5,6\n")
    assert code == 0, told
    session = bench.session()
    assert session.reflector_names == ("A", "B") and session.reflector is not None
    assert session.reflector.tolist() == [0, 1]


def test_the_trackers_orientations_come_along(bench: Bench) -> None:
    joints = "q1,q2,q3\n0.1,0,0\n0.2,0,0\n"
    points = "x,y,z,rx_deg,ry_deg,rz_deg\n1,2,3,0,0,90\n4,5,6,90,0,0\n"
    code, told = bench.run(joints, points)
    assert code == 0, told
    turn = bench.session().turn
    assert turn is not None
    np.testing.assert_allclose(turn[0] @ [1, 0, 0], [0, 1, 0], atol=1e-12)  # yaw: x to y
    np.testing.assert_allclose(turn[1] @ [0, 1, 0], [0, 0, 1], atol=1e-12)  # roll: y to z
    code, told = bench.run(joints, "x,y,z,qx,qy,qz,qw\n1,2,3,0,0,0,1\n4,5,6,1,0,0,0\n", "--force")
    assert code == 0, told
    turn = bench.session().turn
    assert turn is not None
    np.testing.assert_allclose(turn, [np.eye(3), np.diag([1, -1, -1])], atol=1e-12)


def test_dates_and_unix_time_are_one_clock(bench: Bench) -> None:
    joints = "time,q1,q2,q3\n2026-03-01 09:00:00,0.1,0,0\n2026-03-01 09:00:10,0.2,0,0\n"
    points = "timestamp,x,y,z\n1772355610.1,1,2,3\n1772355599.9,4,5,6\n"
    code, told = bench.run(joints, points)
    assert code == 0, told
    assert bench.session().states.q[:, 0].tolist() == pytest.approx([0.2, 0.1])


def test_without_times_rows_go_together_and_shared_columns_must_agree(bench: Bench) -> None:
    joints = "target,q1,q2,q3\nA,0.1,0,0\nB,0.2,0,0\n"
    code, told = bench.run(joints, "target,x,y,z\nA,1,2,3\nB,4,5,6\n")
    assert code == 0 and "row by row with points.csv" in told
    assert bench.session().artefact.target_names == ["A", "B"]
    code, told = bench.run(joints, "target,x,y,z\nA,1,2,3\nC,4,5,6\n", "--force")
    assert code == 2
    assert "row 2, column target: found 'C', expected 'B', as row 2 of joints.csv has it" in told


def test_the_points_own_times_count_where_joints_have_none(bench: Bench) -> None:
    code, _ = bench.run("q1,q2,q3\n0.1,0,0\n0.2,0,0\n", "time_s,x,y,z\n3,1,2,3\n4,4,5,6\n")
    assert code == 0
    assert np.diff(bench.session().states.time_s).tolist() == pytest.approx([1.0])


REFUSED = {
    "seconds and dates": (
        JOINTS,
        "time,x,y,z\n2026-03-01 09:00:00,1,2,3\n",
        "dates or Unix time, and seconds since some instant in joints.csv: two clocks",
    ),
    "no overlap": (
        JOINTS,
        "time_s,x,y,z\n4000,1,2,3\n4001,1,2,3\n",
        "4000 to 4001 s, and 0 to 9 s in joints.csv: two clocks",
    ),
    "times of a day": (
        JOINTS,
        "time,x,y,z\n09:00:00,1,2,3\n",
        "times of a day, expected dates with the times",
    ),
    "a hole": (
        JOINTS,
        "time_s,x,y,z\n0.0,1,2,3\n3.0,1,2,3\n7.1,1,2,3\n",
        "row 2: found 2 points without joints near in time, row 2 the first (2 s)",
    ),
    "rows": ("q1,q2,q3\n0.1,0,0\n", "x,y,z\n1,2,3\n4,5,6\n", "found 2 rows, expected 1, as joints"),
}


@pytest.mark.parametrize("name", list(REFUSED))
def test_what_does_not_go_together_is_refused(name: str, bench: Bench) -> None:
    joints, points, words = REFUSED[name]
    code, told = bench.run(joints, points)
    assert code == 2
    assert "points.csv: " in told and words in told
    assert not bench.written


def test_options_of_two_tables_want_both(bench: Bench) -> None:
    (bench.folder / "joints.csv").write_text(JOINTS, encoding="utf-8")
    words = ["import", str(bench.folder / "joints.csv"), "-o", str(bench.folder / "out")]
    code = main([*words, "--arm", str(bench.folder / "arm.toml"), "--join", "row"])
    assert code == 2
    assert "--join: found no --points" in bench.capsys.readouterr().err


def test_nearest_in_time_is_that_of_brute_force(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    arm_file = tmp_path / "arm.toml"
    arm_file.write_text(ARM, encoding="utf-8")
    one, other = rng.uniform(0.0, 50.0, 200), rng.uniform(1.0, 49.0, 60)
    joints = ForeignTable(
        Path("j"),
        ["time_s", "q1", "q2", "q3"],
        [[repr(t), str(i), "0", "0"] for i, t in enumerate(one.tolist())],
    )
    points = ForeignTable(
        Path("p"), ["time_s", "x", "y", "z"], [[repr(t), "1", "2", "3"] for t in other.tolist()]
    )
    joined = join_tables(joints, points, load_arm(arm_file), "time", 5.0)
    found = [int(row[1]) for row in joined.rows]
    assert found == np.abs(one[:, None] - other).argmin(axis=0).tolist()

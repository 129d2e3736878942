"""`armd compensate`: `armd correct` of the commands has the tip where it is wanted."""

from __future__ import annotations

import csv
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize

from armd.compensation.inverse.compensate import compensate
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import load_calibration, save_calibration
from armd.daemon.cli import main
from armd.files.toml_text import format_toml
from support.drawn import drawn
from support.plain_kinematics import tip_pose
from support.readings import states_of
from support.selection import parametrize_default

#: d, a, α of the joints of arms with three to seven of them.
ROWS = {
    3: [(200, 0, 90), (0, 300, 0), (0, 280, 0)],
    5: [(200, 0, 90), (0, 300, 0), (0, 280, 0), (0, 0, 90), (80, 0, 0)],
    6: [(162.5, 0, 90), (0, -425, 0), (0, -392, 0), (133, 0, 90), (99.7, 0, -90), (99.6, 0, 0)],
    7: [
        (360, 0, -90), (0, 0, 90), (420, 0, 90), (0, 0, -90), (400, 0, -90), (0, 0, 90),
        (126, 0, 0),
    ],
}  # fmt: skip
TERMS: list[dict[str, Any]] = [
    {"parameter": "a_2", "basis": [{"kind": "temperature", "weights": {"t1": 1.0}}],
     "coefficient": 0.02},
    {"parameter": "theta_3", "basis": [{"kind": "sin", "joint": 3}], "coefficient": 4e-4},
    {"parameter": "theta_2", "basis": [{"kind": "gravity_torque", "joint": 2}],
     "coefficient": 1e-5},
    {"parameter": "alpha_2", "basis": [
        {"kind": "temperature", "weights": {"t1": 1.0}}, {"kind": "cos", "joint": 2}],
     "coefficient": 1e-4},
    {"parameter": "theta_1", "basis": [{"kind": "side", "joint": 1}], "coefficient": 1e-4},
    {"parameter": "tip_z", "basis": [{"kind": "approach", "axis": "z"}], "coefficient": 0.05},
]  # fmt: skip


def make(folder: Path, n: int, terms: list[dict[str, Any]] = TERMS, off: float = 1.0) -> Arm:
    joints = [
        {"d_mm": float(d), "a_mm": float(a), "alpha_deg": float(alpha), "min_deg": -175.0,
         "max_deg": 175.0, "temperature": "t1", "mass_kg": 2.0, "counts_per_turn": 1 << 20,
         "centre_of_mass_mm": [10.0, 0.0, 5.0]}
        for d, a, alpha in ROWS[n]
    ]  # fmt: skip
    content = {
        "schema": "armd.arm/1", "serial_number": "ARM-1", "temperature_sensor": [{"name": "t1"}],
        "joint": joints, "tip": {"offset_mm": [20.0, 0.0, 60.0], "radius_mm": 1.0},
    }  # fmt: skip
    (folder / "arm.toml").write_text(format_toml(content))
    arm = load_arm(folder / "arm.toml")
    values, layout = arm.nominal(), arm.layout
    scale = np.where(layout.are_lengths, 0.5, 1e-3)
    values += off * scale * np.random.default_rng(n).normal(size=layout.count)
    calibration = drawn(arm, values=values, terms=terms, temperature_range_c={"t1": (10.0, 30.0)})
    save_calibration(folder / "cal.json", calibration)
    return arm


def draw(arm: Arm, count: int) -> np.ndarray:
    """Postures clear of singularities, the elbow and the wrist bent."""
    rng = np.random.default_rng(3)
    q = rng.uniform(-2.5, 2.5, (count, arm.n_joints))
    bent = {3: [2], 5: [2], 6: [2, 4], 7: [1, 3, 5]}[arm.n_joints]
    q[:, bent] = rng.uniform(0.5, 1.6, (count, len(bent))) * rng.choice([-1, 1], (count, len(bent)))
    if arm.n_joints == 6:
        q[:, 1], q[:, 2] = rng.uniform(-1.2, 0.0, count), rng.uniform(-1.2, -0.5, count)
    return q


def table(path: Path, columns: dict[str, Any]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*(list(v) for v in columns.values()), strict=True))


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def run(folder: Path, command: str, source: str, target: str, *options: str) -> int:
    given = ["--arm", str(folder / "arm.toml"), "--calibration", str(folder / "cal.json")]
    words = [command, str(folder / source), *given, "-o", str(folder / target), *options]
    return main(words)


def angles_of(rows: list[dict[str, str]], n: int, suffix: str = "_command") -> np.ndarray:
    return np.array([[float(row[f"q{k}{suffix}"]) for k in range(1, n + 1)] for row in rows])


def columns_of(arm: Arm, q: np.ndarray, scale: float = 1.0) -> dict[str, Any]:
    count = len(q)
    rng = np.random.default_rng(4)
    columns: dict[str, Any] = {"name": [f'"row, {i}"' for i in range(count)]}
    columns |= {f"q{k + 1}": (q[:, k] / scale).tolist() for k in range(arm.n_joints)}
    columns |= {f"w{k + 1}": rng.normal(size=count).tolist() for k in range(arm.n_joints)}
    return columns | {"t1": rng.uniform(15, 25, count).tolist()}


def nominal_tip(arm: Arm, q: np.ndarray) -> np.ndarray:
    return tip_pose(q, np.tile(arm.nominal(), (len(q), 1)))


@parametrize_default(("n", "unit"), [(6, "rad"), (5, "deg"), (3, "count"), (7, "rad")], default=3)
def test_the_commands_bring_the_tip_there(tmp_path: Path, n: int, unit: str) -> None:
    """Terms of temperature, pose, gravity, side and approach; the approach by the rates."""
    arm = make(tmp_path, n)
    q = draw(arm, 60)
    scale = {"rad": 1.0, "deg": math.radians(1.0), "count": math.tau / (1 << 20)}[unit]
    columns = columns_of(arm, q, scale)
    table(tmp_path / "in.csv", columns)
    option = ("--angle-unit", unit)
    code = run(tmp_path, "compensate", "in.csv", "out.csv", *option)
    rows = rows_of(tmp_path / "out.csv")
    wanted = nominal_tip(arm, q)[:, :3, 3]
    ok = [i for i, row in enumerate(rows) if row["status"] == "ok"]
    assert len(ok) >= 55 and code == int(len(ok) < 60)
    lines = (tmp_path / "in.csv").read_text().splitlines()
    out = (tmp_path / "out.csv").read_text().splitlines()
    assert all(new.startswith(f"{old},") for old, new in zip(lines, out, strict=True))
    again = {name: [values[i] for i in ok] for name, values in columns.items()}
    commands = angles_of([rows[i] for i in ok], n)
    again |= {f"q{k + 1}": commands[:, k].tolist() for k in range(n)}
    table(tmp_path / "again.csv", again)
    assert run(tmp_path, "correct", "again.csv", "points.csv", *option) == 0
    points = rows_of(tmp_path / "points.csv")
    tip = np.array([[float(row[f"{a}_mm"]) for a in "xyz"] for row in points])
    assert np.linalg.norm(tip - wanted[ok], axis=1).max() < 1e-6
    table(tmp_path / "was.csv", columns)
    assert run(tmp_path, "correct", "was.csv", "was-points.csv", *option) == 0
    was = np.array(
        [[float(row[f"{a}_mm"]) for a in "xyz"] for row in rows_of(tmp_path / "was-points.csv")]
    )
    change = np.array([float(row["change_mm"]) for row in rows])
    assert change == pytest.approx(np.linalg.norm(was - wanted, axis=1), abs=1e-7)
    assert max(float(rows[i]["residual_mm"]) for i in ok) < 1e-6


def real_pose(arm: Arm, values: np.ndarray, q: np.ndarray) -> np.ndarray:
    """With one term of the pose, written out."""
    p = np.tile(values, (len(q), 1))
    p[:, 10] += 4e-4 * np.sin(q[:, 2])
    return tip_pose(q, p)


def solve(folder: Path, arm: Arm, q: np.ndarray, wanted: np.ndarray | None = None) -> Any:
    n = len(q)
    states = states_of(q, temperature_c=np.full((n, 1), 20.0), time_s=np.zeros(n))
    return compensate(arm, load_calibration(folder / "cal.json", arm), states, wanted)


@pytest.mark.parametrize("n", [6, 7])
def test_the_orientation_is_kept(tmp_path: Path, n: int) -> None:
    arm = make(tmp_path, n, TERMS[1:2])
    values = load_calibration(tmp_path / "cal.json").content.vector(n)
    q = draw(arm, 100)
    found = solve(tmp_path, arm, q)
    ok = found.is_ok
    assert ok.sum() >= 95
    real, drawn = real_pose(arm, values, found.q[ok]), nominal_tip(arm, q[ok])
    assert np.linalg.norm(real[:, :3, 3] - drawn[:, :3, 3], axis=1).max() < 1e-6
    chord = np.linalg.norm(real[:, :3, :3] - drawn[:, :3, :3], axis=(1, 2))
    assert chord.max() / math.sqrt(2) < 1e-9


@pytest.mark.parametrize(("n", "away_mm"), [(5, 0.0), (5, 40.0), (7, 0.0)])
def test_the_angles_change_least(tmp_path: Path, n: int, away_mm: float) -> None:
    """Against scipy's SLSQP, for wanted tips at and away from the nominal one."""
    arm = make(tmp_path, n, TERMS[1:2])
    values = load_calibration(tmp_path / "cal.json").content.vector(n)
    q = draw(arm, 4)
    drawn = nominal_tip(arm, q)
    way = np.random.default_rng(1).normal(size=(4, 3))
    wanted = drawn[:, :3, 3] + away_mm * way / np.linalg.norm(way, axis=1, keepdims=True)
    found = solve(tmp_path, arm, q, wanted)
    assert found.is_ok.all()
    for i in range(4):

        def missed(step: np.ndarray, i: int = i) -> np.ndarray:
            pose = real_pose(arm, values, (q[i] + step)[None])[0]
            off = (pose[:3, 3] - wanted[i]) / 1000
            if n < 6:
                return off
            apart = pose[:3, :3] @ drawn[i, :3, :3].T
            return np.r_[off, apart[2, 1], apart[0, 2], apart[1, 0]]

        least = minimize(
            lambda step: 0.5 * step @ step, np.zeros(n), jac=lambda step: step, method="SLSQP",
            constraints={"type": "eq", "fun": missed}, options={"ftol": 1e-15, "maxiter": 200},
        )  # fmt: skip
        assert np.abs(missed(least.x)).max() < 1e-7
        mine = float(np.linalg.norm(found.q[i] - q[i]))
        assert mine < np.linalg.norm(least.x) * (1 + 1e-4) + 1e-6


@pytest.mark.slow
def test_rows_that_have_no_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Too far away, a stretched arm, a bent one beside its stop; the others have theirs."""
    arm = make(tmp_path, 6, off=0.2)
    fine = [0.3, -0.8, 1.1, 0.2, 0.9, 0.1]
    q = np.array(
        [
            fine,
            fine,
            [0.3, -0.8, 1.1, 0.2, 0.0, 0.1],  # the wrist is straight
            [math.radians(175.0), *fine[1:]],
            [0.3, -0.8, 1.1, 0.2, 0.0, math.radians(-176.0)],
            [0.3, -0.8, 1.1, 0.2, 0.9, math.radians(-176.0)],
        ]
    )
    columns = columns_of(arm, q) | {"x_mm": ["", 3000.0, *[""] * 4]}
    columns |= {"y_mm": ["", 0.0, *[""] * 4], "z_mm": ["", 0.0, *[""] * 4]}
    table(tmp_path / "in.csv", columns)
    assert run(tmp_path, "compensate", "in.csv", "out.csv") == 1
    rows = rows_of(tmp_path / "out.csv")
    status = [row["status"] for row in rows]
    assert status[:3] == ["ok", "unreachable", "singular"]
    assert status[3] in ("ok", "limit joint 1") and status[4:] == ["singular", "limit joint 6"]
    for row in rows:
        assert (row["q1_command"] == "") == (row["status"] != "ok")
    assert float(rows[1]["residual_mm"]) > 1000
    told = capsys.readouterr().out
    assert "1 unreachable" in told and "2 singular" in told


def test_a_wanted_tip(tmp_path: Path) -> None:
    """A few millimetres from the nominal one, for an arm without a calibration."""
    arm = make(tmp_path, 5)
    q = draw(arm, 20)
    wanted = nominal_tip(arm, q)[:, :3, 3] + [1.0, -2.0, 3.0]
    columns = columns_of(arm, q) | dict(zip(["x_mm", "y_mm", "z_mm"], wanted.T, strict=True))
    table(tmp_path / "in.csv", columns)
    words = ["--arm", str(tmp_path / "arm.toml"), "-o", str(tmp_path / "out.csv")]
    assert main(["compensate", str(tmp_path / "in.csv"), *words]) == 0
    rows = rows_of(tmp_path / "out.csv")
    found = nominal_tip(arm, angles_of(rows, 5))[:, :3, 3]
    assert found == pytest.approx(wanted, abs=1e-6)
    change = [float(row["change_mm"]) for row in rows]
    assert change == pytest.approx([math.sqrt(14)] * 20, abs=1e-6)


@pytest.mark.parametrize(
    ("header", "cells", "said"),
    [
        ("q1,q2", "0,0", "column q3: found no such column"),
        ("q1,q2,q3", "0,,0", "row 1 (line 2), column q2: found nothing, expected a number"),
        ("q1,q2,q3,x_mm,y_mm,z_mm", "0,1,0,5,,5", "column y_mm: found nan"),
        ("q1,q2,q3,status", "0,1,0,ok", "the header: found status already"),
        ("q1,q2,q3", "0,99,0", "column q2: found 99"),
    ],
)
def test_bad_tables(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], header: str, cells: str, said: str
) -> None:
    make(tmp_path, 3)
    (tmp_path / "in.csv").write_text(f"{header}\n{cells}\n")
    assert run(tmp_path, "compensate", "in.csv", "out.csv") == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out.csv").exists()


def test_other_kinds_of_files_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path, 3)
    (tmp_path / "in.csv").write_text("q1,q2,q3\n0,1,1\n")
    assert run(tmp_path, "compensate", "in.csv", "out.parquet") == 2
    (tmp_path / "out.csv").write_text("somebody's,table\n1,2\n")
    assert run(tmp_path, "compensate", "in.csv", "out.csv") == 2
    assert "a table of commands of before" in capsys.readouterr().err

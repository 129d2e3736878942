"""Checks that somebody measured carelessly, or that are none: named by row, or refused."""

from __future__ import annotations

import csv
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from test_interim_history import files_of, measured, run, true_calibration

from armd.compensation.data.sessions.session import load_session
from armd.compensation.interim.checks.admission import refuse_unfit
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import load_calibration
from armd.errors import BadInput
from support.plain_kinematics import tip_pose
from support.selection import parametrize_default

Rows = list[list[str]]
Edit = Callable[[list[str], Rows], Rows]
DAY = "day-06"
TARGET, Q = 2, 3


@pytest.fixture(scope="module")
def checks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = measured(tmp_path_factory.mktemp("checks"))
    true_calibration(folder)
    days = [folder / f"day-{day:02}" for day in range(1, 6)]
    assert run("add", *days, *files_of(folder), "--history", folder / "history") == 0
    return folder


def edited(checks: Path, tmp_path: Path, edit: Edit) -> Path:
    session = Path(shutil.copytree(checks / DAY, tmp_path / DAY))
    table = session / "readings.csv"
    head, *rows = csv.reader(table.read_text().splitlines())
    rows = edit(head, rows)
    table.write_text("".join(",".join(row) + "\n" for row in [head, *rows]))
    return session


def added(checks: Path, tmp_path: Path, session: Path) -> dict:
    history = Path(shutil.copytree(checks / "history", tmp_path / "history"))
    assert run("add", session, *files_of(checks), "--history", history) == 0
    return json.loads((history / "report.json").read_text())


def refused(checks: Path, tmp_path: Path, session: Path) -> str:
    history = tmp_path / "history"
    with pytest.raises(BadInput) as fault:
        run("add", session, *files_of(checks), "--history", history)
    assert not history.exists()
    return str(fault.value)


def in_the_air(checks: Path, which: dict[int, float]) -> Edit:
    """Joint 2 turned so that the tips of *which* rows are so many mm away."""
    arm = load_arm(checks / "arm.toml")
    q = load_session(checks / DAY, arm).states.q
    by = np.eye(arm.n_joints)[1] * 1e-4
    constants = np.tile(arm.nominal(), (len(q), 1))
    moved = (tip_pose(q + by, constants) - tip_pose(q, constants))[:, :3, 3]
    lever = np.linalg.norm(moved, axis=1) / 1e-4

    def edit(head: list[str], rows: Rows) -> Rows:
        for row, mm in which.items():
            rows[row][Q + 1] = repr(float(rows[row][Q + 1]) + float(mm / lever[row]))
        return rows

    return edit


@pytest.mark.slow
@parametrize_default(
    "which",
    [{7: 0.3}, {7: 4.0}, {7: 70.0}, {7: 350.0}, {3: 4.0, 12: 4.0}, {3: 350.0, 12: -300.0}],
    default=1,
)
def test_readings_in_the_air_are_named_and_their_check_does_not_count(
    checks: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], which: dict[int, float]
) -> None:
    session = edited(checks, tmp_path, in_the_air(checks, which))
    rows = list(csv.reader((session / "readings.csv").read_text().splitlines()))
    result = added(checks, tmp_path, session)
    assert result["checks"][-1]["verdict"] == "bad_check" and result["state"] == "in_control"
    told = {f"{DAY}/readings.csv row {i + 1} (line {i + 2}), {rows[i + 1][TARGET]} in P1": abs(mm)
            for i, mm in which.items()}  # fmt: skip
    assert {line.partition(":")[0] for line in result["far_off"]} == set(told)
    for line in result["far_off"]:
        where, _, rest = line.partition(": ")
        assert float(rest.partition(" mm off")[0]) == pytest.approx(told[where], rel=0.1)
        assert rest.endswith("; not counted, as nothing of its check is")
        assert f"Far off: {line}." in capsys.readouterr().out or len(which) > 1


@pytest.mark.slow
def test_new_play_in_a_joint_is_a_change_and_no_reading_gone_wrong(
    checks: Path, tmp_path: Path
) -> None:
    folder = measured(tmp_path / "play", "--plant", "joint_backlash@joint 2=20@6")
    history = Path(shutil.copytree(checks / "history", tmp_path / "history"))
    days = [folder / DAY, folder / "day-07"]
    assert run("add", *days, *files_of(checks), "--history", history) == 1
    result = json.loads((history / "report.json").read_text())
    assert result["changes"][0]["cause"] == "joint_backlash" and result["far_off"] == []


@pytest.mark.slow
def test_the_first_check_of_all_names_its_reading_too(checks: Path, tmp_path: Path) -> None:
    session = edited(checks, tmp_path, in_the_air(checks, {7: 4.0}))
    history = tmp_path / "history"
    run("add", session, *files_of(checks), "--history", history)
    (told,) = json.loads((history / "report.json").read_text())["far_off"]
    assert told.startswith(f"{DAY}/readings.csv row 8 (line 9), ")


def test_good_checks_name_none(checks: Path, tmp_path: Path) -> None:
    assert added(checks, tmp_path, checks / DAY)["far_off"] == []


@pytest.mark.slow
def test_a_row_many_times_makes_no_other_one_far_off(checks: Path, tmp_path: Path) -> None:
    session = edited(checks, tmp_path, lambda _, rows: [*rows[:8], *[rows[7]] * 20, *rows[8:]])
    result = added(checks, tmp_path, session)
    assert result["far_off"] == [] and result["checks"][-1]["verdict"] == "in_control"


@pytest.mark.slow
def test_readings_without_a_temperature_are_named(
    checks: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def edit(head: list[str], rows: Rows) -> Rows:
        rows[3][head.index("t2")] = ""
        return rows

    added(checks, tmp_path, edited(checks, tmp_path, edit))
    said = " ".join(capsys.readouterr().err.split())
    assert f"without a temperature that the calibration needs, not counted: {DAY}/read" in said
    assert "row 4 (line 5)" in said


def one_name(head: list[str], rows: Rows) -> Rows:
    return [[*row[:TARGET], rows[0][TARGET], *row[TARGET + 1 :]] for row in rows]


def exchanged(head: list[str], rows: Rows) -> Rows:
    return [[*row[: Q + 1], row[Q + 2], row[Q + 1], *row[Q + 3 :]] for row in rows]


def column(pattern: str, value: Callable[[float], float]) -> Edit:
    def edit(head: list[str], rows: Rows) -> Rows:
        own = [i for i, name in enumerate(head) if re.fullmatch(pattern, name)]
        for row in rows:
            for i in own:
                row[i] = repr(value(float(row[i])))
        return rows

    return edit


def test_what_is_a_check_of_this_arm_is_admitted_and_what_is_of_none_is_not(
    checks: Path, tmp_path: Path
) -> None:
    arm = load_arm(checks / "arm.toml")
    calibration = load_calibration(checks / "calibration.json").content
    good = load_session(checks / DAY, arm)
    assert refuse_unfit([good], arm, calibration) == []
    stuck = edited(checks, tmp_path, column("q1", lambda _: 0.3))
    with pytest.raises(BadInput, match="half of them more than"):
        refuse_unfit([good, load_session(stuck, arm)], arm, calibration)


@parametrize_default(
    ("edit", "said"),
    [
        (one_name, "readings: found half of them more than .* readings of this arm on this"),
        (exchanged, "by .* if its columns q2 and q3 are exchanged, expected each joint in"),
        (column("q1", lambda _: 0.3), "the readings: found half of them more than "),
        (column(r"t\d", lambda c: 1.8 * c + 32.0), "if its temperatures are taken as °F, "),
        (column(r"t\d", lambda _: 0.0), "temperatures: found t1 0 °C in every row, t2 0 °C"),
        (column("artefact_c", lambda _: 0.0), "found artefact_c 0 °C in every row"),
        (column("t3", lambda _: 0.0), "temperatures: found t3 0 °C in every row, expected"),
        (lambda _, rows: [rows[7]] * 20, "found 20 readings at 1 rest, 0 numbers beyond"),
        (lambda _, rows: rows[:1], "found 1 reading, 0 numbers beyond placement and seats"),
        (lambda _, rows: [], "readings.csv: the file: found no readings, expected at least one"),
    ], default=1)  # fmt: skip
def test_what_is_no_check_is_refused(checks: Path, tmp_path: Path, edit: Edit, said: str) -> None:
    assert re.search(said, refused(checks, tmp_path, edited(checks, tmp_path, edit)))


def test_a_certificate_in_metres_is_refused(checks: Path, tmp_path: Path) -> None:
    session = edited(checks, tmp_path, lambda _, rows: rows)
    file = session / "session.toml"
    text = re.sub(
        r"length_mm = ([\d.]+)", lambda m: f"length_mm = {float(m[1]) / 1e3}", file.read_text()
    )
    file.write_text(text)
    assert "if they are taken as metres, expected distances in mm" in refused(
        checks, tmp_path, session
    )

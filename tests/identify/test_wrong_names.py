"""Readings under another target's name are told by row; what lies nowhere is an outlier."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armd.compensation.data.sessions.session import load_session
from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.identify.admission.mistakes import AssumedModel
from armd.compensation.identify.admission.wrong_names import find_wrong_names
from armd.compensation.model.arm import load_arm
from armd.daemon.cli import main as armd
from support.selection import parametrize_default

NAMES = ("T14", "T20", "T26", "T32")
Q2, TARGET = 4, 2


def rows_of(session: Path) -> list[list[str]]:
    """The readings' cells; row 0 names the columns."""
    return list(csv.reader((session / "readings.csv").read_text().splitlines()))


def edited(session: Path, row: int, column: int, value: str) -> None:
    rows = rows_of(session)
    rows[row][column] = value
    text = "".join(",".join(cells) + "\n" for cells in rows)
    (session / "readings.csv").write_text(text)


def target(session: Path, row: int) -> str:
    return rows_of(session)[row][TARGET]


def sessions(measured: Path) -> list[str]:
    return [str(measured / name) for name in NAMES]


def calibrated(measured: Path) -> int:
    given_ = ["--arm", str(measured / "arm.toml"), "-o", str(measured / "calibration.json")]
    return armd(["calibrate", *sessions(measured), *given_])


def model(measured: Path) -> list[str]:
    """As `calibrated` leaves it."""
    calibration = str(measured / "calibration.json")
    return ["--arm", str(measured / "arm.toml"), "--calibration", calibration]


def renamed(measured: Path) -> str:
    """The operator is one target ahead of the list, three rows long; what is said of the first."""
    session = measured / "T20"
    before = [target(session, row) for row in range(1, 11)]
    told = ""
    for row in (5, 6, 7):
        edited(session, row, TARGET, before[row - 2])
        own, at = before[row - 2], before[row - 1]
        if own != at and not told:
            told = f"row {row} (line {row + 1}) names {own}, "
    return told


@pytest.mark.slow
def test_rows_under_another_name_are_outliers_and_told(
    measured: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = renamed(measured)
    assert calibrated(measured) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "T20: 3 readings of another target: " in said and told in said
    assert "outliers" in said and "does not fit" not in said
    assert "refused: " in said and "delete them from the session or measure them again" in said


@pytest.mark.slow
def test_so_many_that_no_arm_fits_are_refused(
    measured: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A quarter of all readings, the operator being one target ahead of the list."""
    for name in NAMES:
        session = measured / name
        before = [target(session, row) for row in range(1, 161)]
        for row in range(2, 42):
            edited(session, row, TARGET, before[row - 2])
    assert calibrated(measured) == 2
    assert "readings of another target: row " in capsys.readouterr().err
    assert not (measured / "calibration.json").exists()


@pytest.mark.slow
def test_check_tells_of_them(measured: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = renamed(measured)
    assert armd(["check", str(measured / "arm.toml"), str(measured / "T20")]) == 1
    said = capsys.readouterr()
    assert told in said.err
    assert "T20: ok" not in said.out


@pytest.mark.slow
def test_a_diagnosis_names_them(measured: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A reading 100 000 noises off moves a placement by thousands: none was told as an outlier."""
    assert calibrated(measured) == 0
    told = renamed(measured)
    file = measured / "diagnosis.json"
    assert armd(["diagnose", *sessions(measured), *model(measured), "--json", str(file)]) == 0
    assert told in " ".join(capsys.readouterr().out.split())
    result = json.loads(file.read_text())
    assert [finding["cause"] for finding in result["findings"]] == ["outliers"]
    rows = [(row["session"], row["row"]) for row in result["findings"][0]["rows"]]
    assert rows == [("T20", 5), ("T20", 6), ("T20", 7)]
    assert result["baseline"]["noise_floor_um"] == pytest.approx(2.6, rel=0.15)


@pytest.mark.slow
def test_a_reading_in_the_air_is_named_as_why_there_is_no_certificate(
    measured: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = measured / "T20"
    rows = rows_of(session)
    edited(session, 21, Q2, str(float(rows[21][Q2]) + 0.35))
    assert calibrated(measured) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "refused" in said
    assert "mm without 1 down-weighted reading: T20 row 21 (" in said
    assert "no set of constants describes this arm" not in said


@pytest.mark.slow
@parametrize_default(("names", "turn"), [(["T20"], 0.35), (NAMES, 0.35), (NAMES, 0.0005)])
def test_check_names_a_reading_in_the_air(
    measured: Path, capsys: pytest.CaptureFixture[str], names: list[str], turn: float
) -> None:
    """One session under the drawing, and several against each other, where 0.3 mm show."""
    session = measured / "T20"
    rows = rows_of(session)
    edited(session, 21, Q2, str(float(rows[21][Q2]) + turn))
    assert armd(["check", str(measured / "arm.toml"), *(str(measured / n) for n in names)]) == 0
    told = [line for line in capsys.readouterr().out.splitlines() if "far off" in line]
    assert len(told) == 1
    where = (
        f"/readings.csv row 21 (line 22), {rows[21][TARGET]} in " if len(names) == 1 else " row 21 "
    )
    assert told[0].startswith(f"far off (in the air?): T20{where}")


def test_an_evaluation_says_why_it_is_absurd(
    measured: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    told = renamed(measured)
    assert armd(["evaluate", str(measured / "T20"), "--arm", str(measured / "arm.toml")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert told in said and "is it the drawing of this arm?" not in said


@pytest.mark.slow
def test_a_check_with_one_is_not_kept(measured: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A history gives nothing back."""
    assert calibrated(measured) == 0
    told = renamed(measured)
    history = measured / "history"
    check = [str(measured / "T20"), *model(measured), "--history", str(history)]
    assert armd(["interim", "add", *check]) == 2
    assert told in capsys.readouterr().err
    assert not history.exists()


@pytest.fixture(scope="module")
def readings(good: Path) -> Observations:
    arm = load_arm(good / "arm.toml")
    return collect_observations([load_session(good / "T20", arm)], arm)


def as_drawn(observations: Observations) -> AssumedModel:
    return AssumedModel.from_calibration(observations.arm, None)


def test_good_readings_name_their_own(readings: Observations) -> None:
    assert not len(find_wrong_names(readings, as_drawn(readings)).reading)


@pytest.mark.slow
@settings(max_examples=25, deadline=None)
@given(st.data())
def test_just_those_that_are_renamed_are_found(readings: Observations, data: st.DataObject) -> None:
    """Certified targets, and the same ones as seats whose places nobody knows."""
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32 - 1)))
    chosen = np.sort(rng.choice(readings.n, data.draw(st.integers(1, 8)), replace=False))
    touched = np.unique(readings.target)
    wrong = readings.target.copy()
    for i in chosen:
        wrong[i] = rng.choice(touched[touched != wrong[i]])
    changed = replace(readings, target=wrong)
    if data.draw(st.booleans()):
        changed = replace(changed, position_mm=np.full_like(readings.position_mm, np.nan))
    found = find_wrong_names(changed, as_drawn(readings))
    assert found.reading.tolist() == chosen.tolist()
    assert found.touched.tolist() == readings.target[chosen].tolist()
    assert (found.own_mm > found.at_mm).all()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_reading_in_the_air_is_of_no_other_target(readings: Observations, seed: int) -> None:
    """Its distance from all targets is more than what readings miss by under the drawing."""
    rng = np.random.default_rng(seed)
    q = readings.states.q.copy()
    chosen = rng.choice(readings.n, 3, replace=False)
    q[chosen, 1] += rng.choice([-1.0, 1.0], 3) * rng.uniform(0.05, 0.06, 3)
    in_air = replace(readings, states=replace(readings.states, q=q))
    assert not len(find_wrong_names(in_air, as_drawn(readings)).reading)

"""`armd check` on a folder of broken files, each with its expected message."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import Calibration, save_calibration
from armd.daemon.cli import main
from support.known_expansion import known_expansion

ARM = """schema = "armd.arm/1"
serial_number = "TEST"
[[temperature_sensor]]
name = "t1"
[[joint]]
d_mm = 300.0
temperature = "t1"
counts_per_turn = 1000
[[joint]]
a_mm = 400.0
counts_per_turn = 1000
[[joint]]
a_mm = 350.0
counts_per_turn = 1000
"""
DAEMON = """schema = "armd.daemon/1"
arm = "arm.toml"
calibration = "calibration.json"
[driver]
kind = "serial"
port = "/dev/ttyUSB0"
baud = 2000000
"""
SESSION = """schema = "armd.session/1"
arm = "TEST"
started = 2026-03-01T09:00:00Z
[artefact]
name = "seat"
[[artefact.target]]
name = "S"
"""
READINGS = "time_s,placement,target,q1,q2,q3,t1\n0,A,S,0,0,0,20\n1,A,S,0.1,0,0,20\n"
SCENARIO = 'schema = "armd.scenario/1"\nrate_hz = 500\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """One file of every kind, all of them right."""
    (tmp_path / "arm.toml").write_text(ARM)
    arm = load_arm(tmp_path / "arm.toml")
    save_calibration(tmp_path / "calibration.json", known_expansion(arm, 1e-6))
    (tmp_path / "armd.toml").write_text(DAEMON)
    (tmp_path / "session").mkdir()
    (tmp_path / "session/session.toml").write_text(SESSION)
    (tmp_path / "session/readings.csv").write_text(READINGS)
    (tmp_path / "scenario.toml").write_text(SCENARIO)
    (tmp_path / "mpe.toml").write_text('schema = "armd.mpe/1"\n[mpe]\ne_uni_mm = 0.03\n')
    return tmp_path


KINDS = ["arm.toml", "calibration.json", "armd.toml", "session", "scenario.toml", "mpe.toml"]


def check(*paths: Path) -> int:
    return main(["check", *map(str, paths)])


def test_what_is_right_is_ok(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert check(*(folder / name for name in KINDS)) == 0
    output = capsys.readouterr()
    assert output.out.splitlines() == [f"{folder / name}: ok" for name in KINDS]
    assert output.err == ""


def test_a_serial_number_may_be_misspelt(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    damage(folder, "session/session.toml", '"TEST"', '"TSET"')
    assert check(folder / "arm.toml", folder / "session") == 0
    said = "want the arm.toml of 'TSET' among the files: did you mean TEST?)"
    assert said in capsys.readouterr().out


BAR = """[artefact]
name = "bar"
[[artefact.distance]]
between = ["left", "right"]
length_mm = 500.0
"""


def test_files_that_need_not_say_what_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bar, mpe = tmp_path / "bar.toml", tmp_path / "mpe.toml"
    bar.write_text(BAR)
    mpe.write_text("[mpe]\ne_uni_mm = 0.03\n")
    assert check(bar, mpe) == 0
    words = "2 targets, 2 without position; 1 certified length"
    assert capsys.readouterr().out.splitlines() == [f"{bar}: ok ({words})", f"{mpe}: ok"]


@pytest.mark.parametrize(
    ("content", "faults"),
    [
        ('[artefact]\nname = "bar"\n', ["expected the points that were touched: a [[artefact"]),
        (BAR.replace('"left", ', ""), ["artefact.distance[1].between[2]: found nothing"]),
        (
            BAR.replace("[[", '[[artefact.target]]\nname = "lefd"\n[[', 1),
            ["expected a target's name in distance[1], not 'left': did you mean lefd?"],
        ),
    ],
)
def test_an_artefact_that_is_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str, faults: list[str]
) -> None:
    (tmp_path / "bar.toml").write_text(content)
    assert check(tmp_path / "bar.toml") == 1
    told = capsys.readouterr().err.splitlines()
    assert len(told) == len(faults)
    assert all(words in line for words, line in zip(faults, told, strict=True))


def damage(folder: Path, name: str, old: str, new: str) -> Path:
    path = folder / name
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


BROKEN = [
    ("arm.toml", "d_mm", "d_cm", "joint[1].d_cm: found an unknown key, expected one of the"),
    ("arm.toml", "d_mm = 300.0", "d_mm = 'long'", "joint[1].d_mm: found 'long', expected a valid"),
    ("arm.toml", 'temperature = "t1"', 'temperature = "t9"', "'t9'"),
    ("arm.toml", '"TEST"', '"a much too long serial number"', "serial_number: found"),
    ("arm.toml", "[[joint]]\na_mm = 400.0\ncounts_per_turn = 1000\n", "", "joint: found"),
    ("arm.toml", "[[joint]]", "[[joint]", "TOML: found"),
    ("arm.toml", "armd.arm/1", "armd.arm/7", "schema: found 'armd.arm/7', expected one of armd"),
    ("calibration.json", "0.0", "0.5", "content_sha256: found a content that does not match"),
    ("calibration.json", '"TEST"', "5", "arm: found 5, expected a valid string"),
    (
        "calibration.json",
        "{",
        "",
        "line 2 column 10: found ': \"armd.calibration/1\",', expected valid JSON (extra data)",
    ),
    ("armd.toml", "baud", "bawd", "found an unknown key"),
    ("armd.toml", "arm.toml", "leg.toml", "the file: found nothing, expected an existing file"),
    ("armd.toml", "calibration.json", "none.json", "the file: found nothing, expected an existing"),
    ("armd.toml", "2000000", "-1", "baud: found -1, expected"),
    ("session/session.toml", "2026-03-01T09:00:00Z", "2026-03-01", "started: found"),
    ("session/session.toml", '"S"', '""', "artefact.target[1].name: found ''"),
    ("session/readings.csv", "A,S,0.1", "A,S,x", "row 2 (line 3), column q1: found 'x', expected"),
    ("session/readings.csv", "1,A,S", "1,A,T", "row 2 (line 3), column target: found 'T'"),
    ("session/readings.csv", "q3", "q4", "column q3: found no such column"),
    ("session/readings.csv", "20\n1", "2000\n1", "column t1: found 2000, expected a temperature"),
    ("scenario.toml", "rate_hz", "rate", "rate: found an unknown key"),
    ("mpe.toml", "0.03", "0", "mpe.e_uni_mm: found 0"),
    ("scenario.toml", "500", "-5", "rate_hz: found -5, expected"),
]


@pytest.mark.parametrize(("name", "old", "new", "message"), BROKEN)
def test_what_is_wrong_is_named(
    folder: Path, capsys: pytest.CaptureFixture[str], name: str, old: str, new: str, message: str
) -> None:
    path = damage(folder, name, old, new)
    assert check(path) == 1
    output = capsys.readouterr()
    assert output.out == ""
    (line,) = output.err.splitlines()
    assert line.startswith(f"armd: {folder}/")
    assert message in line
    assert ": found " in line and ", expected " in line


@pytest.mark.slow
def test_all_faults_of_all_files(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    damage(folder, "arm.toml", "a_mm = 400.0", "a_mm = 'x'\nb_mm = 1")
    assert check(folder / "arm.toml", folder / "scenario.toml", folder / "armd.toml") == 1
    output = capsys.readouterr()
    faults = [line for line in output.err.splitlines() if line.startswith(f"armd: {folder}/arm.t")]
    assert {line.split(": ")[2] for line in faults} == {"joint[2].a_mm", "joint[2].b_mm"}
    assert output.out == f"{folder / 'scenario.toml'}: ok\n"


def test_a_calibration_must_fit_its_arm(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    content = json.loads((folder / "calibration.json").read_text())
    content["terms"][0]["parameter"] = "d_9"
    save_calibration(folder / "calibration.json", Calibration.model_validate(content))
    assert check(folder / "calibration.json") == 1, "arm.toml stands beside it"
    assert "terms[1].parameter: found 'd_9'" in capsys.readouterr().err


def test_without_an_arm_what_can_be_checked_is(
    folder: Path, capsys: pytest.CaptureFixture[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    elsewhere = tmp_path_factory.mktemp("a") / "b" / "c" / "d"
    shutil.copytree(folder / "session", elsewhere)
    assert check(elsewhere) == 0
    assert "the readings want the arm.toml of 'TEST'" in capsys.readouterr().out
    assert check(elsewhere, folder / "arm.toml") == 0
    assert "want the arm" not in capsys.readouterr().out


def test_unused_columns_are_told(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    damage(folder, "session/readings.csv", "t1\n", "t7\n")
    assert check(folder / "session") == 0
    assert capsys.readouterr().out.endswith(": ok (columns not used: t7)\n")


def test_bad_usage(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert check(folder / "missing.toml") == 2
    assert "missing.toml: the file: found nothing" in capsys.readouterr().err
    (folder / "empty").mkdir()
    assert check(folder / "empty") == 1
    assert "found a folder without session.toml, expected" in capsys.readouterr().err

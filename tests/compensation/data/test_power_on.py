"""tests/field/power-on-85: 85 °C in one cell, or eight, of readings whose neighbours say 27."""

from __future__ import annotations

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.data.sessions.session import load_session, load_session_pieces, load_sessions
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.interim.checks.admission import refuse_unfit
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import Calibration, save_calibration
from armd.daemon.cli import main
from armd.simulator.measured.noise import Noise
from armd.simulator.sessions import KINDS, write_campaign

TRAINING = ("T14", "T20", "T26", "T32")
ONE = ("t2", (76,))
EIGHT = ("t3", (4, 23, 41, 66, 90, 107, 131, 152))


def write_cells(session: Path, column: str, rows: tuple[int, ...], value: str) -> None:
    """As make.sh does."""
    path = session / "readings.csv"
    table = list(csv.reader(path.read_text().splitlines()))
    for row in rows:
        table[1 + row][table[0].index(column)] = value
    with path.open("w", newline="") as file:
        csv.writer(file).writerows(table)


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("clean")
    write_campaign(folder, KINDS["calibration"](21, Noise()), 21)
    return folder


@pytest.fixture(scope="module")
def arm(clean: Path) -> Arm:
    return load_arm(clean / "arm.toml")


@pytest.fixture(scope="module")
def calibration(clean: Path, arm: Arm) -> Calibration:
    sessions = load_sessions([clean / name for name in ("T14", "T32")], arm)
    return calibrate(sessions, arm, Options(thermal_order=1)).calibration


@pytest.fixture
def folder(clean: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(clean, tmp_path / "sick"))


@pytest.mark.parametrize(("column", "rows"), [ONE, EIGHT, ("t5", (0,)), ("artefact_c", (159,))])
@pytest.mark.parametrize("value", ["85.0", "-40", "0"])
def test_the_cells_count_as_missing_and_are_named(
    folder: Path, arm: Arm, column: str, rows: tuple[int, ...], value: str
) -> None:
    before = load_session(folder / "T26", arm)
    write_cells(folder / "T26", column, rows, value)
    session = load_session(folder / "T26", arm)
    (remark,) = session.remarks
    first = rows[0] + 1
    assert remark.startswith(
        f"T26/readings.csv row {first} (line {first + 1}): {column} reads {float(value):g} °C"
    )
    assert "Fahrenheit" not in remark
    read = np.column_stack([session.states.temperature_c, session.artefact_c])
    expected = np.column_stack([before.states.temperature_c, before.artefact_c])
    expected[list(rows), [*arm.sensors, "artefact_c"].index(column)] = np.nan
    np.testing.assert_array_equal(read, expected)
    pieces = list(load_session_pieces(folder / "T26", arm))
    assert tuple(remark for piece in pieces for remark in piece.remarks) == session.remarks


@pytest.mark.slow
def test_a_calibration_is_what_it_is_with_the_cell_empty(folder: Path, arm: Arm) -> None:
    results = []
    for value in ("85.0", ""):
        write_cells(folder / "T26", *ONE, value)
        sessions = load_sessions([folder / name for name in ("T14", "T26", "T32")], arm)
        results.append(calibrate(sessions, arm, Options(thermal_order=1)))
    wrong, empty = results
    assert wrong.calibration.temperature_range_c == empty.calibration.temperature_range_c
    assert wrong.calibration.temperature_range_c["t2"][1] < 40.0
    np.testing.assert_array_equal(wrong.calibration.vector(6), empty.calibration.vector(6))
    assert wrong.certificate.granted and "Fahrenheit" not in wrong.certificate.in_words()
    assert any("row 77" in note for note in wrong.notes)


def test_commands_name_the_cell_and_do_without_it(
    folder: Path, calibration: Calibration, arm: Arm, capsys: pytest.CaptureFixture[str]
) -> None:
    write_cells(folder / "T26", *ONE, "85.0")
    session, cal = folder / "T26", folder / "cal.json"
    save_calibration(cal, calibration)
    under = ["--arm", str(folder / "arm.toml"), "--calibration", str(cal)]
    out = folder / "out.json"
    assert main(["evaluate", str(session), *under, "--json", str(out)]) == 0
    result = json.loads(out.read_text())
    assert result["n_unused"] == 1 and "row 77 (line 78): t2 reads 85 °C" in result["remarks"][0]
    capsys.readouterr()

    points = folder / "points.csv"
    assert main(["correct", str(session / "readings.csv"), *under, "-o", str(points)]) == 0
    assert "row 77 (line 78): t2 reads 85 °C" in capsys.readouterr().err
    rows = list(csv.DictReader(points.read_text().splitlines()))
    assert [i for i, row in enumerate(rows) if row["flags"] != "0"] == [76]
    write_cells(session, *ONE, rows[75]["t2"])  # the last value, which is held
    assert (
        main(["correct", str(session / "readings.csv"), *under, "-o", str(folder / "p.csv")]) == 0
    )
    held = list(csv.DictReader((folder / "p.csv").read_text().splitlines()))
    assert [row["x_mm"] for row in held] == [row["x_mm"] for row in rows]

    write_cells(session, *ONE, "85.0")
    assert main(["check", str(session), str(folder / "arm.toml")]) == 0
    said = capsys.readouterr().out
    assert "row 77 (line 78): t2 reads 85 °C" in said and "in the air" not in said
    remarks = refuse_unfit([load_session(session, arm)], arm, calibration)
    assert any("row 77" in remark for remark in remarks)


@pytest.mark.slow
@pytest.mark.parametrize(("column", "rows"), [ONE, EIGHT])
def test_the_diagnosis_finds_no_cause(
    folder: Path, arm: Arm, column: str, rows: tuple[int, ...]
) -> None:
    """It made a thermal lag of 60 min with 1.000, and a nonlinear expansion with 0.887."""
    write_cells(folder / "T26", column, rows, "85.0")
    diagnosis = diagnose(load_sessions([folder / name for name in TRAINING], arm), arm)
    assert not diagnosis.findings
    assert any(f"row {rows[0] + 1} " in told for told in diagnosis.remarks)

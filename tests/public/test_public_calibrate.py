"""`armd.calibrate` and `armd.evaluate`: the numbers of the commands bit for bit, and residuals as
a rigid fit in plain numpy leaves them."""

from __future__ import annotations

import json
import math
import pickle
import tomllib
from importlib import import_module
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import pyarrow as pa
import pytest

import armd
from armd.daemon.cli import main
from support.measured_arm import MeasuredArm


@pytest.fixture(scope="module")
def calibration(session: armd.Session, measured: MeasuredArm) -> armd.Calibration:
    return armd.calibrate(session, measured.arm_file, thermal="off")


def without_what_names_files(figures: dict[str, Any]) -> dict[str, Any]:
    """The certificate's next step names folders, and the odd session is named by its own."""
    certificate = {**figures["certificate"], "next_step": None}
    return {**figures, "certificate": certificate}


def test_calibrate_gives_the_numbers_of_the_command(
    measured: MeasuredArm, calibration: armd.Calibration, tmp_path: Path
) -> None:
    out, result = tmp_path / "cal.json", tmp_path / "result.json"
    folder = measured.arm_file.parent / "A"
    command = ["calibrate", str(folder), "--arm", str(measured.arm_file), "--thermal", "off"]
    assert main([*command, "-o", str(out), "--json", str(result), "--quiet"]) == 0
    assert calibration.figures is not None
    found = json.loads(json.dumps(calibration.figures))
    assert without_what_names_files(found) == without_what_names_files(
        json.loads(result.read_text())
    )
    written, own = json.loads(out.read_text()), calibration.to_dict()
    for name in ("constants", "terms", "covariance_of", "covariance", "noise"):
        assert own[name] == written[name]
    assert (
        own["provenance"]["sessions"][0]["sha256"] == written["provenance"]["sessions"][0]["sha256"]
    )  # of a session in memory that which its folder has
    assert calibration.rms_um == written["provenance"]["rms_um"]
    assert calibration.heldout_rms_um == written["provenance"]["heldout_rms_um"]
    read = armd.read_calibration(out)
    assert read.to_dict() == written
    read.save(tmp_path / "again.json")
    assert (tmp_path / "again.json").read_bytes() == out.read_bytes()
    assert (read.rms_um, read.heldout_rms_um) == (calibration.rms_um, calibration.heldout_rms_um)
    assert (read.covariance == calibration.covariance).all()


def test_parameters_are_a_table_of_nominal_and_identified(
    measured: MeasuredArm, calibration: armd.Calibration
) -> None:
    table = calibration.parameters
    wanted = ["name", "unit", "nominal", "value", "standard_uncertainty"]
    assert table.column_names == wanted
    names = table["name"].tolist()
    joint = tomllib.loads(measured.arm_file.read_text())["joint"][2]
    d, alpha = names.index("d_3"), names.index("alpha_3")
    assert table["nominal"][[d, alpha]] == pytest.approx(
        [joint["d_mm"], math.radians(joint["alpha_deg"])]
    )
    assert table["unit"][[d, alpha]].tolist() == ["mm", "rad"]
    assert (
        dict(zip(names, table["value"].tolist(), strict=True))
        == (calibration.to_dict()["constants"])
    )
    content = calibration.to_dict()
    for i, name in enumerate(content["covariance_of"]):
        variance = content["covariance"][i][i]
        assert table["standard_uncertainty"][names.index(name)] == math.sqrt(variance)


def test_tables_are_taken_by_arrow_duckdb_pandas_and_polars(calibration: armd.Calibration) -> None:
    parameters = calibration.parameters
    pandas, polars = import_module("pandas"), import_module("polars")
    assert pandas.DataFrame(parameters)["value"].tolist() == parameters["value"].tolist()
    assert polars.DataFrame(parameters)["name"].to_list() == parameters["name"].tolist()
    arrow = pa.table(parameters)
    assert arrow.column("value").to_pylist() == parameters["value"].tolist()
    assert arrow.column("standard_uncertainty").null_count > 0  # β of axes that are not parallel
    found = duckdb.sql("select unit, count(*) n from parameters group by unit order by unit")
    assert found.fetchall() == [("mm", 18), ("rad", 21)]
    rows = list(parameters)
    assert rows[1]["name"] == "d_1" and len(rows) == len(parameters)


def test_evaluate_gives_the_numbers_of_the_command(
    measured: MeasuredArm, calibration: armd.Calibration, tmp_path: Path
) -> None:
    out, cal = tmp_path / "result.json", tmp_path / "cal.json"
    calibration.save(cal)
    folder = measured.arm_file.parent / "A"
    command = ["evaluate", str(folder), "--arm", str(measured.arm_file), "--quiet"]
    assert main([*command, "--calibration", str(cal), "--json", str(out)]) == 0
    found = armd.evaluate(armd.read_session(folder), measured.arm_file, calibration)
    assert found.to_dict() == json.loads(out.read_text())
    assert (found.rms_um, found.max_um) == (
        found.to_dict()["rms_um"], found.residuals["residual_um"].max(),
    )  # fmt: skip


def test_residuals_are_what_a_rigid_fit_leaves(
    measured: MeasuredArm, session: armd.Session, calibration: armd.Calibration
) -> None:
    """Kabsch's rigid fit by placement, of positions that the public model gives."""
    found = armd.evaluate(session, measured.arm_file, calibration).residuals
    columns = measured.columns
    q = np.column_stack([columns[f"q{k}"] for k in range(1, 7)])
    celsius = np.column_stack([columns[f"t{k}"] for k in range(1, 7)])
    position = armd.Model(measured.arm_file, calibration).position(q, celsius)
    known = {one["name"]: one["position_mm"] for one in measured.artefact["target"]}
    certified = np.array([known[name] for name in columns["target"]])
    expected = np.empty((len(q), 3))
    for name in set(columns["placement"]):
        rows = columns["placement"] == name
        tip, target = position[rows], certified[rows]
        u, _, v = np.linalg.svd(
            (tip - tip.mean(axis=0)).T @ (target - target.mean(axis=0)), full_matrices=False
        )
        turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
        placed = (target - target.mean(axis=0)) @ turn.T + tip.mean(axis=0)
        expected[rows] = 1e3 * (tip - placed)
    residual = np.column_stack([found[f"d{axis}_um"] for axis in "xyz"])
    assert residual == pytest.approx(expected, abs=1e-3)
    assert found["residual_um"] == pytest.approx(np.linalg.norm(residual, axis=1), rel=1e-12)
    assert found["row"].tolist() == list(range(1, len(q) + 1))
    assert found["placement"].tolist() == columns["placement"].tolist()
    assert found["target"].tolist() == columns["target"].tolist()
    assert set(found["session"]) == {"session"}


def test_a_reading_without_a_temperature_keeps_its_row(measured: MeasuredArm) -> None:
    """Of a thermal calibration, written by hand: link 2 grows."""
    nominal = armd.read_arm(measured.arm_file)
    columns = {**measured.columns, "t2": measured.columns["t2"].copy()}
    columns["t2"][5] = np.nan
    session = armd.make_session(columns, nominal, artefact=measured.artefact)
    content = armd.calibrate(session, nominal, thermal="off").to_dict()
    factor = {"kind": "temperature", "weights": {"t2": 1.0}}
    content["terms"] = [{"parameter": "a_2", "basis": [factor], "coefficient": 1e-3}]
    from armd.compensation.model.calibration import Calibration
    from armd.offline.calibration import convert_calibration

    warm = convert_calibration(Calibration.model_validate_json(json.dumps(content)))
    found = armd.evaluate(session, nominal, warm)
    assert (found.n, found.to_dict()["n_unused"]) == (71, 1)
    assert len(found.residuals) == 72
    assert np.flatnonzero(np.isnan(found.residuals["residual_um"])).tolist() == [5]


def test_results_print_on_a_screen_and_as_html(
    measured: MeasuredArm, session: armd.Session, calibration: armd.Calibration
) -> None:
    evaluation = armd.evaluate(session, measured.arm_file)
    arm = armd.read_arm(measured.arm_file)
    model = armd.Model(arm, calibration)
    for shown in (arm, session, calibration, calibration.parameters, evaluation, model):
        lines = repr(shown).splitlines()
        assert 0 < len(lines) <= 24 and max(map(len, lines)) <= 100
        assert "<table>" in shown._repr_html_()
    assert set(calibration._repr_mimebundle_()) == {"text/plain", "text/html"}
    assert "<" not in repr(calibration)


def test_files_come_back_as_they_were(measured: MeasuredArm, tmp_path: Path) -> None:
    arm = armd.read_arm(measured.arm_file)
    assert arm.to_dict() == tomllib.loads(measured.arm_file.read_text())
    arm.save(tmp_path / "copy.toml")
    assert (tmp_path / "copy.toml").read_bytes() == measured.arm_file.read_bytes()
    assert (arm.serial_number, arm.n_joints, arm.sensors[0]) == ("SYN-1", 6, "t1")
    assert pickle.loads(pickle.dumps(arm)).to_dict() == arm.to_dict()


@pytest.mark.parametrize("fault", ["a cell", "session.toml", "no folder", "twice"])
def test_what_the_command_refuses_is_refused_with_its_words(
    measured: MeasuredArm, session: armd.Session, tmp_path: Path, fault: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    folder = tmp_path / "B"
    session.save(folder)
    given = [folder]
    if fault == "a cell":
        text = (folder / "readings.csv").read_text().splitlines()
        text[7] = text[7].replace(text[7].split(",")[4], "seven")
        (folder / "readings.csv").write_text("\n".join(text) + "\n")
    elif fault == "session.toml":
        file = folder / "session.toml"
        file.write_text(file.read_text().replace("SYN-1", "SYN-9"))
    elif fault == "no folder":
        given = [tmp_path / "C"]
    else:
        given = [folder, folder]
    out = str(tmp_path / "cal.json")
    words = [*map(str, given), "--arm", str(measured.arm_file)]
    assert main(["calibrate", *words, "-o", out]) == 2
    said = capsys.readouterr().err
    with pytest.raises(armd.BadInput) as refused:
        armd.calibrate([armd.read_session(path) for path in given], armd.read_arm(words[-1]))
    assert said == f"armd: {refused.value}\n"

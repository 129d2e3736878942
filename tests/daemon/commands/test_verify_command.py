"""`armd verify` on a simulated verification session: exit code, JSON, report."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import save_calibration
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from armd.daemon.cli import main
from support.drawn import drawn
from support.simulated_sessions import simulate_sessions


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with arm.toml and the session `verify`."""
    return simulate_sessions(tmp_path_factory.mktemp("measured"), "verify", "--seed", "3")


def verify(measured: Path, *more: str, command: str = "verify") -> int:
    session, arm = str(measured / "verify"), str(measured / "arm.toml")
    return main([command, session, "--arm", arm, *more])


def mpe(folder: Path, **limits: float) -> str:
    lines = [f"{key} = {value}" for key, value in limits.items()]
    path = folder / "mpe.toml"
    path.write_text("\n".join(['schema = "armd.mpe/1"', "[mpe]", *lines]))
    return str(path)


@pytest.mark.slow
def test_wide_limits_are_met(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    limits = mpe(tmp_path, p_size_mm=0.2, p_form_mm=0.5, l_dia_mm=0.5, e_uni_mm=0.5)
    result, report = tmp_path / "result.json", tmp_path / "report.html"
    files = ["--json", str(result), "--report", str(report)]
    assert verify(measured, "--mpe", limits, *files) == 0
    assert "verdict: PASSED" in capsys.readouterr().out
    data = json.loads(result.read_text())
    assert data["passed"] is True
    assert data["not_supported"] == {}
    assert len(data["figures"]) == 10
    assert len(data["figures"]["e_uni"]["deviations"]) == 105
    assert {item["outcome"] for item in data["figures"].values()} == {"conforms", "not judged"}
    text = report.read_text()
    assert "E_Uni: every result" in text
    assert "<script src" not in text, "opens offline"
    assert "<link" not in text


@pytest.mark.slow
def test_a_narrow_limit_is_not(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert verify(measured, "--mpe", mpe(tmp_path, p_size_mm=0.2, e_uni_mm=0.001)) == 1
    assert "verdict: FAILED" in capsys.readouterr().out


@pytest.mark.slow
def test_without_limits_no_verdict(measured: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert verify(measured) == 0
    output = capsys.readouterr().out
    assert "no verdict" in output
    assert "verdict:" not in output.replace("no verdict", "")


def test_unknown_limits_are_refused(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert verify(measured, "--mpe", mpe(tmp_path, p_sise_mm=0.2)) == 2
    assert "mpe.p_sise_mm: found an unknown key" in capsys.readouterr().err


def test_a_calibration_that_overflows_is_refused(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arm = load_arm(measured / "arm.toml")
    heat = Temperature(kind="temperature", weights={arm.sensors[0]: 1.0})
    term = Term(parameter="a_2", basis=[heat], coefficient=1e308)
    warmer_c = arm.reference_temperature_c + 5.0
    calibration = drawn(arm, reference_temperature_c=warmer_c, terms=[term])
    path, result = tmp_path / "cal.json", tmp_path / "result.json"
    save_calibration(path, calibration)
    for command in ("verify", "evaluate"):
        assert verify(
            measured, "--calibration", str(path), "--json", str(result), command=command
        ) not in (0, 70)
        printed = capsys.readouterr()
        assert "points that are not finite" in printed.err and "rows 1, 2" in printed.err
        assert "nan" not in printed.out and "inf" not in printed.out
    assert not result.exists()

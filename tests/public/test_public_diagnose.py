"""`armd.diagnose`, `armd.verify`, `armd.design`: what the commands write, and their refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure

import armd
from armd.daemon.cli import main
from support.measured_arm import MeasuredArm, measured_arm
from support.simulated_sessions import list_sessions, simulate_sessions

PLANTED = "encoder_eccentricity@joint 3=1.5"


def simulated(folder: Path, kind: str, *more: str) -> list[str]:
    return list_sessions(simulate_sessions(folder, kind, *more))


def plain(result: dict[str, Any]) -> Any:
    return json.loads(json.dumps(result))


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_diagnose_gives_what_the_command_writes(tmp_path: Path) -> None:
    sessions = simulated(tmp_path / "sick", "diagnosis", "--plant", PLANTED)
    arm, out, written = (str(tmp_path / name) for name in ("sick/arm.toml", "d.json", "e.json"))
    command = ["diagnose", *sessions, "--arm", arm, "--json", out, "--extended", written]
    assert main([*command, "--quiet"]) == 0
    found = armd.diagnose(sessions, arm)
    expected = json.loads(Path(out).read_text())
    assert plain(found.to_dict()) == expected | {"extended_calibration": None}
    first = found.findings[0]
    assert (first.cause, first.location) == ("encoder_eccentricity", "joint 3")
    assert first.gain.heldout_rms_um_after < first.gain["heldout_rms_um_before"]
    assert first.parameters[0].unit == "rad"
    assert repr(first).startswith("<encoder_eccentricity, joint 3: probability ")
    assert found.baseline.noise_floor_um == expected["baseline"]["noise_floor_um"]
    extended = found.extended
    assert extended is not None
    content = json.loads(Path(written).read_text())
    for name in ("constants", "terms", "covariance"):
        assert extended.to_dict()[name] == content[name]
    assert armd.evaluate(sessions, arm, extended).rms_um < found.baseline.rms_um
    assert isinstance(found.plot(), Figure)
    axes = Figure().subplots()
    assert found.plot(0, ax=axes) is axes.figure and axes.lines
    with pytest.raises(ValueError, match="finding 99 of"):
        found.plot(99)
    found.report(tmp_path / "page.html")
    assert "encoder eccentricity" in (tmp_path / "page.html").read_text()
    assert len(repr(found).splitlines()) <= 24


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_design_gives_what_the_command_writes(tmp_path: Path) -> None:
    sessions = simulated(tmp_path / "sick", "diagnosis", "--plant", PLANTED)[-2:]
    arm, out = str(tmp_path / "sick" / "arm.toml"), str(tmp_path / "design.json")
    command = ["design", *sessions, "--arm", arm, "--poses", "3", "--json", out, "--quiet"]
    assert main(command) == 0
    found = armd.design(arm, sessions, readings=3)
    assert plain(found.to_dict()) == json.loads(Path(out).read_text())
    assert found.poses["pose"].tolist() == [1, 2, 3]
    axes = Figure().subplots()
    assert found.plot(ax=axes) is axes.figure and len(axes.lines) == 3
    found.report(tmp_path / "page.html")
    assert "MEASURE 3 POSES" in (tmp_path / "page.html").read_text()


@pytest.mark.slow
def test_verify_gives_what_the_command_writes(tmp_path: Path) -> None:
    (session,) = simulated(tmp_path / "test", "verify")
    arm, out, limits = (str(tmp_path / name) for name in ("test/arm.toml", "v.json", "mpe.toml"))
    Path(limits).write_text("[mpe]\ne_uni_mm = 0.02\n")
    command = ["verify", session, "--arm", arm, "--mpe", limits, "--json", out, "--quiet"]
    code = main(command)
    found = armd.verify(session, arm, None, limits)
    assert plain(found.to_dict()) == json.loads(Path(out).read_text())
    assert found.passed is (code == 0)
    by_data = armd.verify(session, arm, mpe={"mpe": {"e_uni_mm": 0.02}})
    assert by_data.to_dict() == found.to_dict()
    assert armd.verify(session, arm).passed is None
    by_data.report(tmp_path / "page.html")
    assert "as data" in (tmp_path / "page.html").read_text()


def test_what_cannot_be_diagnosed_or_verified_is_refused(
    measured: MeasuredArm, session: armd.Session, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    folder = tmp_path / "A"
    session.save(folder)
    command = ["diagnose", str(folder), "--arm", str(measured.arm_file), "--holdout", str(folder)]
    assert main(command) == 2
    with pytest.raises(armd.BadInput) as refused:
        armd.diagnose(folder, measured.arm_file, holdout=folder)
    assert capsys.readouterr().err == f"armd: {refused.value}\n"
    assert main(["verify", str(folder), "--arm", str(measured.arm_file)]) == 2
    with pytest.raises(armd.ArmdError, match="no test is complete") as incomplete:
        armd.verify(folder, measured.arm_file, None)
    assert capsys.readouterr().err == f"armd: {incomplete.value}\n"
    with pytest.raises(armd.BadInput, match=r"mpe: mpe\.e_uni_mm: found 40, expected mm, 5 at"):
        armd.verify(session, measured.arm_file, mpe={"mpe": {"e_uni_mm": 40}})


def test_what_cannot_be_designed_is_refused(measured: MeasuredArm, session: armd.Session) -> None:
    with pytest.raises(armd.BadInput, match="--poses: value: found 0, expected 1 to"):
        armd.design(measured.arm_file, session, readings=0)
    with pytest.raises(armd.BadInput, match="artefact: value: found it with sessions"):
        armd.design(measured.arm_file, session, artefact={"name": "bar"})


@pytest.mark.slow
def test_the_report_of_a_calibration_read_has_no_sessions(
    measured: MeasuredArm, session: armd.Session, tmp_path: Path
) -> None:
    calibration = armd.calibrate(session, measured.arm_file, thermal="off")
    calibration.report(tmp_path / "page.html")
    assert "Calibration of SYN-1" in (tmp_path / "page.html").read_text()
    calibration.save(tmp_path / "cal.json")
    with pytest.raises(armd.ArmdError, match="no report: its sessions are not at hand"):
        armd.read_calibration(tmp_path / "cal.json").report(tmp_path / "page.html")


@pytest.mark.slow
def test_poses_before_any_session_are_those_of_the_command(tmp_path: Path) -> None:
    measured = measured_arm(tmp_path)
    output = tmp_path / "first.json"
    command = ["design", "--arm", str(measured.arm_file), "--readings", "20", "--json", str(output)]
    assert main(command) == 0
    chosen = armd.design(measured.arm_file, readings=20)
    assert chosen.to_dict() == json.loads(output.read_text())
    assert len(chosen.poses) == 20 and set(chosen.observability) == {"O1", "O2", "O3", "O4", "O5"}
    assert chosen.rank <= chosen.structural_rank
    assert len(chosen.plot().axes) == 2
    whole = Figure()
    flat, space = whole.add_subplot(121), whole.add_subplot(122, projection="3d")
    assert chosen.plot(ax=flat) is whole and len(flat.lines) == 20
    assert flat.get_ylabel() == "z, mm"
    assert chosen.plot(ax=space) is whole and len(space.lines) == 20
    assert len(whole.axes) == 2
    with pytest.raises(armd.BadInput, match="found 3, expected"):
        armd.design(measured.arm_file, readings=3)

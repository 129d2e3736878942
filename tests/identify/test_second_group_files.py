"""A tip exchanged in the middle of a simulated session: what the commands say of its files."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from armd.daemon.cli import main as armd
from support.selection import parametrize_default
from support.simulated_sessions import simulate_sessions

EXCHANGED_UM = 8000.0


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tip is another one from some row of T14 on."""
    folder = tmp_path_factory.mktemp("exchanged") / "measured"
    plant = f"tip_offset@tip={EXCHANGED_UM:g}"
    return simulate_sessions(folder, "calibration", "-q", "--plant", plant)


@pytest.mark.slow
@parametrize_default("names", [["T14"], ["T14", "T20"], ["T14", "T20", "T26"]])
def test_check_names_the_rows_of_another_tip(
    measured: Path, capsys: pytest.CaptureFixture[str], names: list[str]
) -> None:
    sessions = [str(measured / name) for name in names]
    assert armd(["check", str(measured / "arm.toml"), *sessions]) == 1
    said = capsys.readouterr()
    assert f"armd: {measured / 'T14'}: the session: found rows 1 to 61 of session T14" in said.err
    assert f"{measured / 'T14'}: ok" not in said.out
    assert all(f"{measured / name}: ok" in said.out for name in names[1:])
    far = re.search(r"measured with another tip .*?, ([\d.]+) ± ([\d.]+) mm from it", said.err)
    assert far is not None
    assert abs(float(far[1]) - EXCHANGED_UM / 1e3) < 3.0 * float(far[2]) < 0.3


def test_calibrate_names_them_and_what_to_do(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["calibrate", str(measured / "T14"), "--arm", str(measured / "arm.toml")]
    assert armd([*command, "-o", str(tmp_path / "calibration.json")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "refused:" in said and "rows 1 to 61 of session T14: measured with another tip" in said
    assert "Next: one calibration holds one tip, delete rows 1 to 61 of session T14" in said
    assert "no set of constants" not in said and "armd diagnose" not in said

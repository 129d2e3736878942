"""The examples of docs/how-to/python.md and of the public names' docstrings run as they stand."""

from __future__ import annotations

import doctest
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import armd
from armd.offline.results.arrow_table import ArrowTable
from support.measured_arm import measured_arm
from support.pages import page_path, run_as_typed, shell_blocks
from support.simulated_sessions import simulate_sessions

PAGE = page_path("python")
QUICK = [
    "read_arm", "read_calibration", "read_session", "make_session", "calibrate", "evaluate",
    "Model", "Corrector",
]  # fmt: skip
LONG = ["verify", "diagnose", "design"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the examples name: an arm, a session of it, a calibration."""
    folder = tmp_path_factory.mktemp("examples")
    (folder / "measured").mkdir()
    measured = measured_arm(folder / "measured")
    text = measured.arm_file.read_text().replace("SYN-1", "SIM-0001")
    measured.arm_file.write_text(text)
    session = armd.make_session(measured.columns, measured.arm_file, artefact=measured.artefact)
    session.save(folder / "measured" / "T20")
    armd.calibrate(session, measured.arm_file).save(folder / "calibration.json")
    return folder


def run_example(name: str, tested: object, folder: Path) -> None:
    """Run the examples of a docstring in *folder*."""
    given = {"armd": armd, "np": np, "Path": Path, "ArrowTable": ArrowTable}
    tests = doctest.DocTestFinder(recurse=False).find(tested, name, globs=given)
    assert tests and tests[0].examples
    before = Path.cwd()
    os.chdir(folder)
    try:
        assert doctest.DocTestRunner().run(tests[0]).failed == 0
    finally:
        os.chdir(before)


@pytest.mark.parametrize("name", [*QUICK, "ArrowTable"])
def test_an_example_gives_what_it_shows(name: str, folder: Path) -> None:
    run_example(name, ArrowTable if name == "ArrowTable" else getattr(armd, name), folder)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("simulated")
    plant = "encoder_eccentricity@joint 3=1.5"
    simulate_sessions(folder / "test", "verify")
    simulate_sessions(folder / "sick", "diagnosis", "--plant", plant)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("name", LONG)
def test_a_long_example_gives_what_it_shows(name: str, simulated: Path) -> None:
    run_example(name, getattr(armd, name), simulated)


def test_the_page_names_every_public_name() -> None:
    text = PAGE.read_text(encoding="utf-8")
    named = set(re.findall(r"`(?:armd\.)?(\w+)", text))
    assert set(armd.__all__) - named == set()


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_the_page_runs_from_an_empty_folder(tmp_path: Path) -> None:
    text = PAGE.read_text(encoding="utf-8")
    run_as_typed("".join(shell_blocks(text)), tmp_path)
    blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    script = "\n".join(block for block in blocks if "armd.connect(" not in block)
    environment = {**os.environ, "MPLBACKEND": "Agg"}
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, env=environment, capture_output=True,
        text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    for name in ("calibration.json", "calibration.html", "diagnosis.html", "extended.json"):
        assert (tmp_path / name).stat().st_size


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_short_script_does_the_six_commands_of_the_readme(tmp_path: Path) -> None:
    """It gives what the commands give; what calibrations say of their making aside."""
    script = Path(__file__).with_name("six_commands.py")
    assert len(script.read_text(encoding="utf-8").splitlines()) <= 50
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    done = subprocess.run(
        [sys.executable, script], cwd=tmp_path, env={**os.environ, "PATH": path},
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    six = next(block for block in shell_blocks(readme) if "armd calibrate" in block)
    assert len(six.splitlines()) == 6
    (tmp_path / "commands").mkdir()
    run_as_typed(six, tmp_path / "commands")
    for name in ("calibration.json", "extended.json", "diagnosis.json"):
        ours, theirs = (
            json.loads((folder / name).read_text()) for folder in (tmp_path, tmp_path / "commands")
        )
        for key in ("created", "provenance", "content_sha256", "schema", "extended_calibration"):
            ours.pop(key, None), theirs.pop(key, None)
        assert ours and ours == theirs, name
    assert (tmp_path / "calibration.html").stat().st_size

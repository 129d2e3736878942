"""The README's promises: its subscriber is the tested example, its commands run as they stand."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from support.pages import run_as_typed

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def block(language: str, after: str) -> str:
    """The first code block of a language after a heading."""
    found = re.search(rf"```{language}\n(.*?)```", README.partition(after)[2], re.DOTALL)
    assert found is not None
    return found[1]


def test_the_subscriber_is_the_example_that_is_tested() -> None:
    shown = block("python", "## A subscriber")
    assert shown == (ROOT / "docs/examples/subscriber.py").read_text(encoding="utf-8")


def test_both_commands_are_targets() -> None:
    commands = [line.split("#")[0].split() for line in block("sh", "## Two").splitlines()]
    targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert commands == [["make", "demo"], ["make", "test"]]
    assert {"demo", "test"} <= set(targets)


def metrology(sick: bool) -> list[str]:
    """The README's commands for the metrology engineer: of the good arm, or of the sick one."""
    lines = block("sh", "## For the metrology engineer").splitlines(keepends=True)
    chosen = [line for line in lines if ("sick" in line) == sick]
    assert len(chosen) == (2 if sick else 4)
    return chosen


def test_calibrate_and_verify_run_as_the_readme_says(tmp_path: Path) -> None:
    run_as_typed("".join(metrology(sick=False)), tmp_path)
    assert json.loads((tmp_path / "calibration.json").read_text())["arm"]
    assert "html" in (tmp_path / "calibration.html").read_text()[:100].lower()


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the README's sick arm was measured."""
    folder = tmp_path_factory.mktemp("readme")
    run_as_typed(metrology(sick=True)[0], folder)
    return folder


def test_the_sick_arm_is_measured_as_the_readme_says(measured: Path) -> None:
    assert len(list((measured / "sick").glob("session-*/readings.csv"))) >= 5


def test_diagnose_finds_what_the_readme_says(measured: Path) -> None:
    run_as_typed(metrology(sick=True)[1], measured)
    first = json.loads((measured / "diagnosis.json").read_text())["findings"][0]
    assert (first["cause"], first["location"]) == ("encoder_eccentricity", "joint 3")
    assert "1.5 µm off centre" in first["reading"]
    assert first["gain"]["heldout_rms_um_after"] < first["gain"]["heldout_rms_um_before"]

"""The README's promises: its subscriber is the tested example, its commands run as they stand."""

from __future__ import annotations

import json
import re
from pathlib import Path

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


def test_the_metrology_commands_run_and_find_what_the_readme_says(tmp_path: Path) -> None:
    run_as_typed(block("sh", "## For the metrology engineer"), tmp_path)
    first = json.loads((tmp_path / "diagnosis.json").read_text())["findings"][0]
    assert (first["cause"], first["location"]) == ("encoder_eccentricity", "joint 3")
    assert "1.5 µm off centre" in first["reading"]
    assert first["gain"]["heldout_rms_um_after"] < first["gain"]["heldout_rms_um_before"]

"""The blocks of the offline pages run as they stand, one after the other, from an empty folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.pages import page_path, run_as_typed, shell_blocks

#: page → what it leaves behind
PAGES = {
    "first-hour": ("my-arm/armd.toml", "calibration.html", "verify.html"),
    "calibrate": ("calibration.json", "calibration.html"),
    "verify": ("calibration.json", "verify.html"),
    "offline": ("points.csv",),
    "model": ("corrected.urdf", "corrections.csv", "corrections.json", "commands.csv"),
    "twin": ("extended.json", "twin/session-8/readings.csv", "again.json", "truth.jsonl"),
    "diagnosis": ("diagnosis.html", "extended.json", "poses.csv", "poses.html"),
}


@pytest.mark.parametrize("name", PAGES)
def test_what_is_looked_for_is_what_the_page_writes(name: str) -> None:
    """Without running it: what no block names would be looked for in vain, minutes later."""
    typed = "".join(shell_blocks(page_path(name).read_text(encoding="utf-8")))
    assert typed and [file for file in PAGES[name] if Path(file).parts[0] not in typed] == []


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", PAGES)
def test_the_page_runs_from_an_empty_folder(name: str, tmp_path: Path) -> None:
    text = page_path(name).read_text(encoding="utf-8")
    blocks = shell_blocks(text)
    assert blocks
    run_as_typed("".join(blocks), tmp_path)
    assert [file for file in PAGES[name] if not (tmp_path / file).stat().st_size] == []

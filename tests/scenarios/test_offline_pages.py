"""The blocks of the offline pages run as they stand, one after the other, from an empty folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from support.pages import run_as_typed, shell_blocks

DOCS = Path(__file__).parents[2] / "docs"
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


@pytest.mark.parametrize("page", PAGES)
def test_what_is_looked_for_is_what_the_page_writes(page: str) -> None:
    """Without running it: what no block names would be looked for in vain, minutes later."""
    typed = "".join(shell_blocks((DOCS / f"{page}.md").read_text(encoding="utf-8")))
    assert typed and [name for name in PAGES[page] if Path(name).parts[0] not in typed] == []


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("page", PAGES)
def test_the_page_runs_from_an_empty_folder(page: str, tmp_path: Path) -> None:
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    blocks = shell_blocks(text)
    assert blocks
    run_as_typed("".join(blocks), tmp_path)
    assert [name for name in PAGES[page] if not (tmp_path / name).stat().st_size] == []

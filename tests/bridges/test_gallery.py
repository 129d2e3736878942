"""docs/tutorials/gallery.md is what `make gallery` writes, and its pictures are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from gallery import REPORTS, draw_visits, page_of, run

DOCS = Path(__file__).parents[2] / "docs" / "tutorials"


def test_the_page_is_what_the_command_writes() -> None:
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    said = page.rsplit("\n```\n", 2)[1]
    assert page == page_of(said)
    for figure in ("µm", "verif"):
        assert figure in said


def test_each_picture_is_there() -> None:
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", page)
    assert len(pictures) == 2 + len(REPORTS)
    for picture in pictures:
        assert (DOCS / picture).stat().st_size > 10_000, picture


@pytest.mark.slow
def test_the_commands_make_the_reports(tmp_path: Path) -> None:
    draw_visits(tmp_path / "visits.csv")
    for shown in REPORTS:
        for command in shown.commands:
            run(command, tmp_path)
        assert (tmp_path / f"{shown.name}.html").stat().st_size > 10_000, shown.name

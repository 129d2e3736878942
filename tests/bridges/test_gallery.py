"""docs/gallery.md is what `make gallery` writes, and its pictures are there."""

from __future__ import annotations

import re
from pathlib import Path

from gallery import REPORTS, page_of

DOCS = Path(__file__).parents[2] / "docs"


def test_the_page_is_what_the_command_writes() -> None:
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    said = page.rsplit("```text\n", 1)[1].removesuffix("```\n")
    assert page == page_of(said)
    for figure in ("µm", "verif"):
        assert figure in said


def test_each_picture_is_there() -> None:
    page = (DOCS / "gallery.md").read_text(encoding="utf-8")
    pictures = re.findall(r"!\[[^]]+\]\(([^)]+)\)", page)
    assert len(pictures) == 2 + len(REPORTS)
    for picture in pictures:
        assert (DOCS / picture).stat().st_size > 10_000, picture

"""The site of `make docs`: every public name of `armd` has its entry, no link is broken."""

from __future__ import annotations

import os
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import armd

REFERENCE = Path(__file__).parents[2] / "docs" / "reference"
DIRECTIVE = re.compile(r"^\.\. (?:auto|py:)\w+:: (armd\.[\w.]+)", re.M)
#: What public names give or return, and no name of armd gives.
RETURNED = {"armd.offline.results.arrow_table.ArrowTable", "armd.offline.results.record.Record"}
RETURNED |= {"armd.stream.Handle", "armd.stream.Stream"}


def site() -> Path:
    if "ARMD_SITE" not in os.environ:
        pytest.skip("make docs builds the site")
    return Path(os.environ["ARMD_SITE"])


class Page(HTMLParser):
    """What a page links to, and what in it can be linked to."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if value and name in ("href", "src"):
                self.links.add(value)
            elif value and name in ("id", "name"):
                self.anchors.add(value)


def find_broken_links(folder: Path) -> list[str]:
    """Return `PAGE: LINK` of each link within the site that leads nowhere."""
    pages = {path: Page(path) for path in sorted(folder.rglob("*.html"))}
    broken = []
    for path, page in pages.items():
        for link in sorted(page.links):
            to = urlsplit(link)
            if to.scheme or to.netloc:
                continue
            target = (path.parent / unquote(to.path)).resolve() if to.path else path
            anchor = unquote(to.fragment)
            anchors = pages[target].anchors if target in pages else {anchor}
            if not target.is_file() or (anchor and anchor not in anchors):
                broken.append(f"{path.relative_to(folder)}: {link}")
    return broken


def test_the_reference_has_every_public_name_once() -> None:
    pages = sorted(REFERENCE.glob("*.rst"))
    described = [name for page in pages for name in DIRECTIVE.findall(page.read_text())]
    assert sorted(described) == sorted({f"armd.{name}" for name in armd.__all__} | RETURNED)
    listed = (REFERENCE / "index.rst").read_text().split()
    assert {page.stem for page in pages} - {"index"} <= set(listed)


def test_broken_links_are_found(tmp_path: Path) -> None:
    (tmp_path / "a.html").write_text("<p id='x'><a href='b.html#y'></a><img src='none.png'>")
    (tmp_path / "b.html").write_text(
        "<a href='a.html#x'></a><a href='#z'></a><a href='a.html'></a>"
    )
    assert find_broken_links(tmp_path) == ["a.html: b.html#y", "a.html: none.png", "b.html: #z"]


@pytest.mark.slow
def test_every_public_name_has_an_entry_of_the_site() -> None:
    inventory = pytest.importorskip("sphinx.util.inventory").InventoryFile
    data = (site() / "objects.inv").read_bytes()
    entries = {
        name: item.uri
        for kind, objects in inventory.loads(data, uri="").data.items()
        if kind.startswith("py:")
        for name, item in objects.items()
    }
    index = Page(site() / "genindex.html").links
    searched = (site() / "searchindex.js").read_text(encoding="utf-8")
    for name in armd.__all__:
        page, _, anchor = entries[f"armd.{name}"].replace("#$", f"#armd.{name}").partition("#")
        assert page.startswith("docs/reference/"), name
        assert anchor in Page(site() / page).anchors, name
        assert f"{page}#{anchor}" in index, name
        assert f'"{name}"' in searched, name


@pytest.mark.slow
def test_no_link_of_the_site_is_broken() -> None:
    assert find_broken_links(site()) == []


@pytest.mark.slow
def test_notebooks_are_shown_with_their_figures() -> None:
    for name in ("own-arm", "hidden-cause", "live-arm"):
        text = (site() / "docs" / "notebooks" / f"{name}.html").read_text(encoding="utf-8")
        assert "<img" in text and "cell_output" in text, name

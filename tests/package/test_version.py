"""One version in every file that states it, and the newest release of the changelog is that one."""

from __future__ import annotations

import datetime
import re
import tomllib
from pathlib import Path

import armd

ROOT = Path(__file__).parents[2]
RELEASE = re.compile(r"## (\d+\.\d+\.\d+), (\d{4}-\d{2}-\d{2})")


def changelog() -> list[str]:
    return (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").splitlines()


def test_every_file_states_the_same_version() -> None:
    projects = [ROOT / "pyproject.toml", ROOT / "deploy" / "client" / "pyproject.toml"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    cited = re.findall(r"^version: (\S+)$", citation, re.MULTILINE)
    stated = [tomllib.loads(path.read_text("utf-8"))["project"]["version"] for path in projects]
    assert {*stated, *cited} == {armd.__version__} and len(cited) == 1


def test_the_newest_release_of_the_changelog_is_this_version() -> None:
    heads = [line for line in changelog() if line.startswith("## ")]
    assert heads[0] == "## Unreleased"
    releases = [RELEASE.fullmatch(head) for head in heads[1:]]
    assert all(releases), f"CHANGELOG.md: found {heads[1:]}, expected '## 1.2.3, 2026-11-28'"
    found = [(match[1], match[2]) for match in releases if match]
    dates = [datetime.date.fromisoformat(date) for _, date in found]
    assert found[0][0] == armd.__version__ and dates == sorted(dates, reverse=True)
    released = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"date-released: {found[0][1]}\n" in released


def test_the_changelog_has_one_line_for_each_change() -> None:
    kinds = {line for line in changelog() if line.startswith("### ")}
    assert kinds <= {"### Added", "### Changed", "### Fixed", "### Removed"}
    entries = [line for line in changelog() if line.startswith("- ")]
    too_long = [line[:60] for line in entries if len(line.split()) > 40]
    assert too_long == [], "CHANGELOG.md: found entries of over 40 words, expected one line"

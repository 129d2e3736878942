"""The commands that the pages about bridges show are commands that armd takes."""

from __future__ import annotations

import argparse
import importlib
import re
import shlex
from pathlib import Path

import pytest

from armd.daemon.cli import module_of

DOCS = Path(__file__).parents[2] / "docs"
PAGES = [
    "stream.md", "ippdme.md", "pc-dmis.md", "verisurf.md", "ros2.md", "fleet.md", "export.md",
    "recorrect.md", "import.md", "view.md",
]  # fmt: skip


def commands(page: str) -> list[list[str]]:
    text = (DOCS / page).read_text(encoding="utf-8")
    blocks = "\n".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL)).replace("\\\n", " ")
    return [shlex.split(line, comments=True) for line in blocks.splitlines() if "armd " in line]


@pytest.mark.parametrize("page", PAGES)
def test_commands_are_taken(page: str) -> None:
    shown = commands(page)
    assert shown
    for program, name, *words in shown:
        assert program == "armd"
        module = importlib.import_module(module_of(name))
        parser = argparse.ArgumentParser(exit_on_error=False)
        module.add_arguments(parser)
        parser.parse_args(words)


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page: str) -> None:
    text = (DOCS / page).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([a-z][\w/.-]+\.md)[)#]", text):
        assert (DOCS / target).exists(), target

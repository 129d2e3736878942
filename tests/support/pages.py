"""Blocks of a page, run as a reader would: in one shell, from a folder of their own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"


def page_path(name: str) -> Path:
    """Find a page of docs/ by its name, whichever folder it is in."""
    (path,) = DOCS.glob(f"*/{name}.md")
    return path


def shell_blocks(text: str) -> list[str]:
    return re.findall(r"```sh\n(.*?)```", text, re.DOTALL)


def run_as_typed(commands: str, folder: Path) -> str:
    """What they print; fails at the first command that does."""
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-e", "-c", commands],
        cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout

"""Sessions as `armd simulate --session KIND` writes them, in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path


def simulate_sessions(folder: Path, kind: str, *more: str) -> Path:
    """Write them to *folder*, and return it."""
    command = [sys.executable, "-m", "armd.simulator", "--session", kind, "-o", str(folder)]
    subprocess.run([*command, *more], check=True, stdout=subprocess.DEVNULL)
    return folder


def list_sessions(folder: Path) -> list[str]:
    """The folders of all sessions in *folder*, by their names."""
    return sorted(str(file.parent) for file in folder.glob("*/session.toml"))

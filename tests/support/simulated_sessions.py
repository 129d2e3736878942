"""Sessions as `armd simulate --session KIND` writes them, in a process of its own."""

from __future__ import annotations

import csv
import subprocess
import sys
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np


def simulate_sessions(folder: Path, kind: str, *more: str) -> Path:
    """Write them to *folder*, and return it."""
    command = [sys.executable, "-m", "armd.simulator", "--session", kind, "-o", str(folder)]
    subprocess.run([*command, *more], check=True, stdout=subprocess.DEVNULL)
    return folder


def list_sessions(folder: Path) -> list[str]:
    """The folders of all sessions in *folder*, by their names."""
    return sorted(str(file.parent) for file in folder.glob("*/session.toml"))


def read_plainly(folder: Path) -> tuple[dict[str, Any], list[dict[str, str]]]:
    """A session as any program would read it: session.toml and the rows."""
    with (folder / "readings.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    return tomllib.loads((folder / "session.toml").read_text()), rows


def numbers(rows: list[dict[str, str]], names: Sequence[str]) -> np.ndarray:
    """(n, columns) of these *names*."""
    return np.array([[float(row[name]) for name in names] for row in rows])

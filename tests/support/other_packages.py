"""Packages that bring something to armd: the template of docs/developer/plugins.md, installed as a
person would, and others made of a few lines."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from support.program import run_armd

TEMPLATE = Path(__file__).parents[2] / "docs" / "examples" / "plugin"


def install_template(folder: Path) -> Path:
    """Install the template into a folder below *folder*, without network; returns that folder."""
    source, target = folder / "source", folder / "installed"
    shutil.copytree(TEMPLATE, source)  # a build leaves files beside it
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    command += ["--no-index", "--no-deps", "--no-build-isolation", "--target", str(target)]
    subprocess.run([*command, str(source)], check=True)
    return target


def make_package(folder: Path, name: str, entry_points: str, module: str = "") -> Path:
    """Write to *folder* what an installed distribution *name* 1.0 leaves there, with one module
    of that name."""
    information = folder / f"{name}-1.0.dist-info"
    information.mkdir(parents=True)
    (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(entry_points)
    (folder / f"{name}.py").write_text(module)
    return folder


def environment_with(folder: Path) -> dict[str, str]:
    """The environment of a process that finds the packages in *folder*."""
    return {**os.environ, "PYTHONPATH": str(folder)}


def armd_with(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run `armd` where the packages in *folder* are installed."""
    return run_armd(*words, env=environment_with(folder))

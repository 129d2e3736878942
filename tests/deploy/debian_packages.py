"""Debian packages by name, unpacked into a folder of our own: nothing is installed on this machine.

The machine's own apt configuration says where packages come from; no host stands here.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

CACHE = Path(__file__).resolve().parents[2] / ".cache" / "system"
QUIET = {**os.environ, "LC_ALL": "C", "DEBIAN_FRONTEND": "noninteractive"}


class Unavailable(Exception):
    """This machine cannot fetch Debian packages; the text says why."""


def unpacked(*packages: str) -> Path:
    """The folder holding *packages* and those of their dependencies that this machine lacks.

    Fetched on first use, then taken from the cache. Raises `Unavailable`.
    """
    folder = CACHE / "packages" / "+".join(packages)
    if folder.exists():
        return folder
    part = folder.with_name(folder.name + ".part")
    shutil.rmtree(part, ignore_errors=True)
    downloads = part / "debs"
    downloads.mkdir(parents=True)
    # Simulated, as no right to install is needed to ask what an installation would bring.
    plan = _apt("install", "--simulate", "--reinstall", "--no-install-recommends", *packages)
    names = {line.split()[1] for line in plan.splitlines() if line.startswith("Inst ")}
    _apt("download", *sorted(names | set(packages)), cwd=downloads)
    for deb in sorted(downloads.glob("*.deb")):
        subprocess.run(["dpkg-deb", "-x", str(deb), str(part)], check=True)
    shutil.rmtree(downloads)
    part.rename(folder)
    return folder


def sources() -> str:
    """The machine's package sources, one `deb …` line each, for a tool that builds a system."""
    form = "$(CREATED_BY) deb $(REPO_URI) $(RELEASE) $(COMPONENT)"
    lines = _apt("indextargets", "--format", form).splitlines()
    found = [line.removeprefix("Packages ") for line in lines if line.startswith("Packages ")]
    return "\n".join(dict.fromkeys(found)) + "\n"


def _apt(command: str, *arguments: str, cwd: Path | None = None) -> str:
    """Run apt-get on package lists of our own, so that neither root nor fresh lists are needed."""
    if not shutil.which("apt-get"):
        raise Unavailable("no apt-get on this machine")
    lists, archives = CACHE / "apt" / "lists", CACHE / "apt" / "archives"
    options = [f"-oDir::State::Lists={lists}", f"-oDir::Cache={archives}", "-oDebug::NoLocking=1"]
    options += ["-oAPT::Sandbox::User=root", "-oAPT::Get::List-Cleanup=0"]
    if not lists.exists():
        (archives / "archives" / "partial").mkdir(parents=True, exist_ok=True)
        fresh = lists.with_name("lists.part")
        (fresh / "partial").mkdir(parents=True, exist_ok=True)
        update = [*options, f"-oDir::State::Lists={fresh}", "update", "-qq"]
        subprocess.run(["apt-get", *update], env=QUIET, check=False, capture_output=True)
        fresh.rename(lists)
    run = subprocess.run(
        ["apt-get", "-q", *options, command, *arguments],
        cwd=cwd,
        env=QUIET,
        check=False,
        capture_output=True,
        text=True,
    )
    if run.returncode != 0:
        raise Unavailable(f"apt-get {command}: {run.stderr.strip()}")
    return run.stdout

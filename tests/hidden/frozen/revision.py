"""A revision of armd in an environment of its own: its files, importable, beside the installed
dependencies."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

#: The packages of a revision from before armd/ was a folder: umbrella/ was armd itself.
ROOMS = ("compensation", "daemon", "drivers", "simulator")
#: What a revision's commands do not inherit: settings of Python and armd, and of the tests that
#: start them (a process of theirs would take itself for one of their workers).
DROPPED = ("PYTHON", "ARMD_", "PYTEST_")
START = "import sys; from armd.daemon.cli import main; sys.exit(main())"


@dataclass(frozen=True)
class Revision:
    commit: str  # 40 digits
    path: Path  # what PYTHONPATH has

    @property
    def short(self) -> str:
        return self.commit[:7]

    def command(self, *words: str) -> list[str]:
        return [sys.executable, "-c", START, *words]

    def environment(self, cache: Path) -> dict[str, str]:
        """With one thread, and compiled functions kept in *cache*."""
        return make_environment(cache) | {"PYTHONPATH": str(self.path)}


def make_environment(cache: Path) -> dict[str, str]:
    """That of this process without what is dropped; one thread, and what numba compiles kept in
    *cache*."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(DROPPED)}
    one_thread = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    return inherited | one_thread | {"NUMBA_CACHE_DIR": str(cache)}


def commit_of(root: Path, name: str) -> str:
    """The commit that a revision's name stands for."""
    words = ["git", "-C", str(root), "rev-parse", "--verify", "--quiet", f"{name}^{{commit}}"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"armd: BASE: found {name!r}, expected a revision of this repository")
    return done.stdout.strip()


def is_dirty(root: Path) -> bool:
    """Whether tracked files differ from the commit."""
    words = ["git", "-C", str(root), "status", "--porcelain", "--untracked-files=no"]
    return bool(subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip())


def check_out(root: Path, commit: str, folder: Path) -> Revision:
    """The files of a commit in *folder*, made if it is not there."""
    files = folder / commit[:12]
    if not files.exists():
        making = folder / f".{commit[:12]}-{os.getpid()}"
        making.mkdir(parents=True)
        archive = subprocess.run(
            ["git", "-C", str(root), "archive", commit], capture_output=True, check=True
        ).stdout
        subprocess.run(["tar", "-x", "-C", str(making)], input=archive, check=True)
        shutil.rmtree(making / "tests", ignore_errors=True)
        if (making / "umbrella").exists():
            _link_packages(making)
        making.rename(files)
    return Revision(commit, files)


def _link_packages(files: Path) -> None:
    (files / "armd").mkdir()
    for one in (files / "umbrella").iterdir():
        (files / "armd" / one.name).symlink_to(Path("..", "umbrella", one.name))
    for room in ROOMS:
        (files / "armd" / room).symlink_to(Path("..", room))

"""A commit's files with a virtual environment of their own, in which a mutant is tried.

The environment finds every package where the one that runs this has it, except armd itself: that
is the copy's, also in processes that tests start with another environment, folder or `-I`.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import sysconfig
import venv
from dataclasses import dataclass
from pathlib import Path

from hidden.frozen.revision import make_environment

HAS_LIBRARY = "from armd.compiled import library; assert library.load_libraries()"
#: Of a processor: far more than a library takes to compile.
LIBRARY_S = 400
SCRIPTS_LEFT_OUT = ("activate", "Activate", "python")


@dataclass(frozen=True)
class Copy:
    """The files of a commit in *root*, the environment in root/.venv."""

    root: Path
    #: where numba keeps what it compiles
    compiled: Path

    @property
    def python(self) -> Path:
        return self.root / ".venv/bin/python"

    @property
    def library_folder(self) -> Path:
        """Where the copy's library of compiled functions lies."""
        return self.root / ".venv/share/armd"

    def environment(self, **more: str) -> dict[str, str]:
        """Variables for the copy's commands: a revision's, its own programs first, and *more*."""
        path = f"{self.python.parent}:{os.environ.get('PATH', '')}"
        venv_paths = {"PATH": path, "VIRTUAL_ENV": str(self.root / ".venv")}
        return make_environment(self.compiled) | venv_paths | more


def make_copy(repository: Path, commit: str, root: Path) -> Copy:
    """Check the commit out in *root*, where nothing may be, as a worktree of the repository."""
    git = ["git", "-C", str(repository), "worktree"]
    subprocess.run([*git, "prune"], check=True)
    subprocess.run([*git, "add", "--quiet", "--detach", "--force", str(root), commit], check=True)
    _make_environment(root)
    copy = Copy(root, root.parent / f"{root.name}-compiled")
    has_library = [str(copy.python), "-I", "-c", HAS_LIBRARY]
    if subprocess.run(has_library, env=copy.environment()).returncode:
        make_library(copy)
    return copy


def remove_copy(repository: Path, copy: Copy) -> None:
    git = ["git", "-C", str(repository), "worktree", "remove", "--force", str(copy.root)]
    subprocess.run(git, check=True)
    shutil.rmtree(copy.compiled, ignore_errors=True)


def make_library(copy: Copy) -> bool:
    """Whether the functions of the copy's sources compile; its library then has them."""
    words = ["-I", "-m", "armd.compiled.ahead", "--into", str(copy.library_folder)]
    command, environment = [str(copy.python), *words], copy.environment()
    done = subprocess.run(
        command, env=environment, capture_output=True, preexec_fn=_limit_processor_time
    )
    return done.returncode == 0


def _limit_processor_time() -> None:
    """Where a mutant never ends, in the process that makes the library."""
    resource.setrlimit(resource.RLIMIT_CPU, (LIBRARY_S, LIBRARY_S))


def _make_environment(root: Path) -> None:
    folder, base = root / ".venv", Path(sys.prefix)
    venv.create(folder, symlinks=True)
    (packages,) = folder.glob("lib/python*/site-packages")
    installed = sysconfig.get_path("purelib")
    lines = [str(root), f"import site; site.addsitedir({installed!r})"]
    (packages / "copy.pth").write_text("\n".join(lines) + "\n", encoding="utf-8")
    for script in (base / "bin").iterdir():
        if not script.name.startswith(SCRIPTS_LEFT_OUT):
            _copy_script(script, folder / "bin" / script.name, base, folder)
    if (base / "share/armd").is_dir():
        shutil.copytree(base / "share/armd", folder / "share/armd")


def _copy_script(script: Path, to: Path, base: Path, folder: Path) -> None:
    """With the copy's Python in its first line; what is no such script becomes a link."""
    first, newline, rest = script.read_bytes().partition(b"\n")
    interpreter = str(base / "bin").encode()
    if first.startswith(b"#!") and interpreter in first:
        first = first.replace(interpreter, str(folder / "bin").encode())
        to.write_bytes(first + newline + rest)
        to.chmod(0o755)
    else:
        to.symlink_to(script)

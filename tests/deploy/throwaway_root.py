"""A throw-away copy of this very machine: what is changed in it lies in a folder of its own."""

from __future__ import annotations

import os
import stat
import subprocess
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
#: With a /tmp of its own each time, in which the project is copied: it may lie in a /tmp or on
#: another file system. The folder is no part of /: layers must not overlap.
ENTER = """\
mount -t overlay overlay -o lowerdir=/,upperdir="$1/upper",workdir="$1/work" "$1/root"
for folder in proc sys dev; do mount --rbind "/$folder" "$1/root/$folder"; done
mount -t tmpfs tmpfs "$1/root/tmp"
mkdir "$1/root$3"
tar -C "$2" --exclude=./.venv --exclude=./.git --exclude=./.cache --exclude=./build -c . |
    tar -C "$1/root$3" -x
root=$1/root; shift 3
exec chroot "$root" "$@"
"""
#: Where in it the project lies.
INSIDE = Path("/", "tmp", "project")
SUDO_PATH = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"


class Unavailable(Exception):
    """This machine lets nobody mount an overlay; the text says why."""


class ThrowawayRoot:
    """Commands run in it as root, with the project at `INSIDE` and this machine's network,
    and without its systemd."""

    def __init__(self, folder: Path) -> None:
        """*folder* is empty, on a file system other than the root's. Raises `Unavailable`."""
        self.folder = folder
        for name in ("upper", "work", "root"):
            (folder / name).mkdir()
        tried = self.run("true")
        if tried.returncode != 0:
            raise Unavailable(tried.stderr.strip())

    def run(self, *command: str | Path) -> subprocess.CompletedProcess[str]:
        enter = ["unshare", "--mount", "--propagation=private", "sh", "-euc", ENTER, "sh"]
        return subprocess.run(
            [*enter, self.folder, PROJECT, INSIDE, *command],
            capture_output=True,
            text=True,
            env={**os.environ, "PATH": SUDO_PATH, "LC_ALL": "C"},
        )

    def path(self, path: str) -> Path:
        """Where a file that was changed or made in it lies."""
        return self.folder / "upper" / path.removeprefix("/")

    def changes(self) -> set[str]:
        """Files and folders that are not as on this machine."""
        upper = self.folder / "upper"
        paths = {Path("/") / path.relative_to(upper): path for path in upper.rglob("*")}
        return {str(own) for own, copy in paths.items() if not _same(own, copy)}


def _same(own: Path, copy: Path) -> bool:
    mode = copy.lstat().st_mode
    if not os.path.lexists(own) or stat.S_IFMT(own.lstat().st_mode) != stat.S_IFMT(mode):
        return False
    if stat.S_ISREG(mode):
        return own.read_bytes() == copy.read_bytes()
    return stat.S_ISDIR(mode) or (stat.S_ISLNK(mode) and own.readlink() == copy.readlink())

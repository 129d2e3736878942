"""A 64-bit ARM Python on this machine: Debian's, run by qemu-user, with armd's wheels for it.

Nothing is installed: packages are unpacked into a folder, and apt keeps its lists there too.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import cobs

import armd

PROJECT = Path(__file__).resolve().parents[2]
#: What `python3.11` needs to import what the tests do.
PACKAGES = [
    "python3.11-minimal", "libpython3.11-minimal", "libpython3.11-stdlib", "libc6", "libgcc-s1",
    "libstdc++6", "zlib1g", "libexpat1", "libffi8", "libssl3", "libbz2-1.0", "liblzma5",
    "libsqlite3-0", "libuuid1", "libcrypt1", "libnsl2", "libtirpc3",
]  # fmt: skip
APT = """\
APT::Architectures {{ "{host}"; "arm64"; }};
Dir::State "{folder}/state";
Dir::State::status "{folder}/state/status";
Dir::Cache "{folder}/cache";
Debug::NoLocking "true";
"""


class Unavailable(Exception):
    """It cannot be had here; the text says why."""


class Arm64Python:
    """Runs in the project's folder, as tests do."""

    def __init__(self, folder: Path) -> None:
        """Fetch and unpack it into an empty *folder*, 0.6 GB. Raises `Unavailable`."""
        self._folder = folder
        if missing := [name for name in ("apt-get", "dpkg", "dpkg-deb") if not shutil.which(name)]:
            raise Unavailable(f"no {missing[0]}: this is no Debian")
        for name in ("state/lists/partial", "cache/archives/partial", "debs"):
            (folder / name).mkdir(parents=True)
        (folder / "state/status").touch()
        host = _ran(["dpkg", "--print-architecture"]).strip()
        (folder / "apt.conf").write_text(APT.format(host=host, folder=folder))
        apt = {"APT_CONFIG": str(folder / "apt.conf")}
        _ran(["apt-get", "--quiet", "update"], apt)
        wanted = [f"{name}:arm64" for name in PACKAGES] + [f"qemu-user-static:{host}"]
        _ran(["apt-get", "--quiet", "download", *wanted], apt, folder / "debs")
        for package in (folder / "debs").iterdir():
            _ran(["dpkg-deb", "--extract", str(package), str(folder / "root")])

    def add(self, wheels: Sequence[str]) -> None:
        """Those fetched into a folder, and cobs, whose Python half is for any processor."""
        site = self._folder / "site"
        for wheel in wheels:
            shutil.unpack_archive(wheel, site, "zip")
        source = Path(cobs.__file__).parent
        shutil.copytree(source, site / "cobs", ignore=shutil.ignore_patterns("*.so", "__pycache__"))

    def run(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """`python3.11 ARGUMENTS`, armd and its tests importable."""
        root = self._folder / "root"
        paths = [self._folder / "site", Path(armd.__file__).parents[1], PROJECT / "tests"]
        own = {
            "PYTHONPATH": os.pathsep.join(map(str, paths)),
            "PYTHONDONTWRITEBYTECODE": "1",
            "XDG_CACHE_HOME": str(self._folder / "cache"),
            "OPENBLAS_NUM_THREADS": "1",
        }
        return subprocess.run(
            [
                root / "usr/bin/qemu-aarch64-static",
                "-L",
                root,
                root / "usr/bin/python3.11",
                *arguments,
            ],
            cwd=PROJECT,
            env={**os.environ, **own},
            capture_output=True,
            text=True,
        )


def _ran(command: list[str], more: dict[str, str] | None = None, cwd: Path | None = None) -> str:
    done = subprocess.run(
        command, env={**os.environ, **(more or {})}, cwd=cwd, capture_output=True, text=True
    )
    if done.returncode != 0:
        raise Unavailable(f"{' '.join(command[:3])}: {done.stderr.strip()[-300:]}")
    return done.stdout

"""`deploy/install.sh` from the package index, twice, and away again, on a throw-away root."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest
import throwaway_root
from debian_packages import unpacked
from throwaway_root import INSIDE, ThrowawayRoot

INSTALL = INSIDE / "deploy" / "install.sh"
NEEDED_BYTES = 3 << 30
CODE, LIBRARY = "/var/cache/armd/numba/", "/site-packages/armd/kernel_"
AS_ARMD = ["setpriv", "--reuid=armd", "--regid=armd", "--clear-groups"]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ThrowawayRoot]:
    ask = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest"]
    if subprocess.run([*ask, tmp_path_factory.mktemp("index"), "pyserial"]).returncode != 0:
        pytest.skip("no package index to install from")
    memory = Path("/dev/shm")
    if not memory.is_dir() or shutil.disk_usage(memory).free < NEEDED_BYTES:
        pytest.skip(f"{memory} has no {NEEDED_BYTES >> 30} GiB free")
    with tempfile.TemporaryDirectory(dir=memory, prefix="armd-root-") as folder:
        try:
            copy = ThrowawayRoot(Path(folder))
        except throwaway_root.Unavailable as error:
            pytest.skip(str(error))
        yield copy


def install(root: ThrowawayRoot, *options: str) -> str:
    run = root.run("sh", INSTALL, *options)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout.splitlines()[-1]


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1800)
def test_from_the_index_twice_and_away(root: ThrowawayRoot) -> None:
    if root.run("sh", "-c", "command -v udevadm").returncode != 0:  # as in a container
        root.path("/usr/bin").mkdir(parents=True)
        shutil.copy(unpacked("udev") / "bin/udevadm", root.path("/usr/bin"))
    before = root.changes()

    assert install(root) == "armd: installed; it starts with the machine"
    first = root.changes()
    assert "/etc/systemd/system/multi-user.target.wants/armd.service" in first
    version = root.run(*AS_ARMD, "armd", "--version")
    assert version.returncode == 0, version.stderr
    complete = ". /usr/local/share/bash-completion/completions/armd && complete -p armd"
    assert root.run("bash", "-euc", complete).stdout.startswith("complete ")
    assert ".TH ARMD 1" in root.path("/usr/local/share/man/man1/armd.1").read_text()

    # The program that the service starts finds what was compiled for it, and compiles nothing.
    assert len([path for path in first if LIBRARY in path]) == 1
    code = {path for path in first if path.startswith(CODE)}
    python = root.run("head", "-1", "/opt/armd/bin/armd").stdout.strip().removeprefix("#!")
    cached = [*AS_ARMD, "env", "CACHE_DIRECTORY=/var/cache/armd"]
    again = root.run(*cached, python, "-I", "-m", "armd.compiled.ahead")
    assert again.returncode == 0, again.stderr
    assert {path for path in root.changes() if path.startswith(CODE)} == code
    first = root.changes()

    install(root)
    # The second is built beside the first, which goes; nothing else is another.
    moved = {path.replace("/opt/armd.b", "/opt/armd.a") for path in root.changes()}
    compiled = {path for path in moved ^ first if "__pycache__" in path or path.startswith(CODE)}
    assert moved ^ first == compiled

    root.path("/etc/armd/armd.toml").write_text("mine")
    install(root, "--uninstall")
    left = root.changes() - before - passwords()
    assert left == {"/etc/armd", "/etc/armd/armd.toml"}
    assert "armd" in root.path("/etc/passwd").read_text()

    install(root, "--uninstall", "--purge")
    assert root.changes() - before - backups() == set()


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_python_in_somebodys_home_is_refused(root: ThrowawayRoot) -> None:
    python = root.path("/root/python")
    python.parent.mkdir(parents=True, exist_ok=True)
    python.write_text(
        "#!/bin/sh\n"
        'exec python3 -c \'import sys; sys.base_prefix = "/root/x"; exec(sys.argv[1])\' "$3"\n'
    )
    python.chmod(0o755)
    before = root.changes()
    run = root.run("env", "PYTHON=/root/python", "sh", INSTALL)
    assert run.returncode == 2
    assert "/root/python: found a Python in somebody's home" in run.stderr
    assert "expected the system's: PYTHON=/usr/bin/python3" in run.stderr
    assert root.changes() == before


def passwords() -> set[str]:
    """The lists of users and groups, in which armd's own stays."""
    return {f"/etc/{name}" for name in ("passwd", "group", "shadow", "gshadow")} | backups()


def backups() -> set[str]:
    """What every change of those leaves behind."""
    names = ("passwd-", "group-", "shadow-", "gshadow-", "subuid-", "subgid-", ".pwd.lock")
    return {f"/etc/{name}" for name in names}


def test_a_folder_that_is_missing_is_named_before_anything_is_done() -> None:
    """What runs without a root: the script of this checkout, as anybody."""
    script = Path(__file__).parents[2] / "deploy" / "install.sh"
    run = subprocess.run(["sh", script, "--wheelhouse"], capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (2, "")
    assert run.stderr == "armd: --wheelhouse: found nothing, expected a folder\n"

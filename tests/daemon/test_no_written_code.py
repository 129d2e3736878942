"""With its library of compiled functions the daemon executes nothing that was written to memory, as
systemd's MemoryDenyWriteExecute asks (decision 5)."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from armd.compiled import library
from support.running_daemon import free_endpoint, running_daemon, write_config
from support.simulated_arm import simulated_arm

FORBIDDING = (sys.executable, str(Path(__file__).parents[1] / "support/no_written_code.py"))
EXECUTABLE = "import mmap; mmap.mmap(-1, 4096, prot={prot})"


@pytest.fixture(autouse=True)
def can_be_forbidden() -> None:
    if subprocess.run([*FORBIDDING, "true"], capture_output=True).returncode != 0:
        pytest.skip("this machine lets nobody filter system calls")


@pytest.mark.parametrize(("prot", "allowed"), [("1 | 2", True), ("1 | 4", True), ("7", False)])
def test_it_is_forbidden(prot: str, allowed: bool) -> None:
    """The test below can fail."""
    command = [*FORBIDDING, sys.executable, "-c", EXECUTABLE.format(prot=prot)]
    run = subprocess.run(command, capture_output=True, text=True)
    assert (run.returncode == 0) is allowed
    assert allowed or "Error" in run.stderr


@pytest.mark.slow
def test_the_daemon_streams_all_the_same(tmp_path: Path) -> None:
    if not library.load_libraries():
        pytest.skip("no library of compiled functions: there was no C++ compiler to make it")
    with (
        simulated_arm(tmp_path) as arm,
        running_daemon(arm.folder, arm.port, through=FORBIDDING) as daemon,
        daemon.listen() as heard,
    ):
        heard.wait_for(lambda: len(heard.points()) > 500)
        assert daemon.stop()[0] == 0


@pytest.mark.slow
def test_without_its_library_it_says_what_forbids_it(tmp_path: Path) -> None:
    """Numba is here, and may not compile."""
    pytest.importorskip("numba")
    with simulated_arm(tmp_path) as arm:
        config = write_config(arm.folder, arm.port, free_endpoint())
        command = [*FORBIDDING, sys.executable, "-m", "armd", "run", config]
        without = os.environ | {"ARMD_WITHOUT_LIBRARY": "1"}
        run = subprocess.run(command, env=without, capture_output=True, text=True, timeout=60)
    assert run.returncode == 2
    assert "found that no machine code may be written to memory" in run.stderr
    assert "MemoryDenyWriteExecute=no" in run.stderr and "Traceback" not in run.stderr

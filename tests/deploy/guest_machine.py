"""Boot the guest under User-Mode Linux; where that does not run, under qemu's emulation."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import tarfile
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from debian_packages import CACHE, unpacked
from guest_image import HELLO, build_image, make_filesystem
from guest_qemu import Qemu

RESULTS_BYTES = 64 << 20
MEMORY_BYTES = 3 << 30


class Machine(Protocol):
    """What can boot a disk image."""

    modules: Path
    stage_s: float
    """What a stage may take: a few minutes at nearly native speed."""

    def command(self, disks: Sequence[Path], words: str) -> list[str]:
        """The command that boots from the first of *disks* with *words* for the kernel."""

    def disk(self, number: int) -> str:
        """The device under which the guest sees disk *number*."""


class Uml:
    """A Linux kernel that is a program: nearly native speed, no privilege, one CPU."""

    stage_s = 1500.0

    def __init__(self) -> None:
        tools = unpacked("user-mode-linux", "mmdebstrap")
        self.kernel = tools / "usr/bin/linux.uml"
        (self.modules,) = (tools / "usr/lib/uml/modules").iterdir()
        # User-Mode Linux alone fails on processors with AVX-512; the source says how and why.
        source = Path(__file__).with_name("uml_xstate.c")
        self.shim = CACHE / "uml_xstate.so"
        build = ["cc", "-O2", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
        subprocess.run([*build, "-o", self.shim, source], check=True)

    def command(self, disks: Sequence[Path], words: str) -> list[str]:
        drives = [f"ubd{number}={disk}" for number, disk in enumerate(disks)]
        console = "con0=null,fd:1 con1=null con=null ssl=null console=tty0"
        start = ["env", f"LD_PRELOAD={self.shim}", str(self.kernel), f"mem={MEMORY_BYTES}"]
        return [*start, *drives, *console.split(), *words.split()]

    def disk(self, number: int) -> str:
        return f"/dev/ubd{'abc'[number]}"


def machine(folder: Path) -> Machine:
    """User-Mode Linux if it runs here, else qemu; MACHINE=uml or qemu decides otherwise."""
    choice = os.environ.get("MACHINE", "")
    if choice != "qemu":
        uml = Uml()
        command = uml.command([build_image(uml.modules)], f"root={uml.disk(0)} init=/sbin/hello")
        console = folder / "hello.console"
        with contextlib.suppress(TimeoutError):
            run(command, console, 60)
        if choice == "uml" or HELLO in console.read_text(errors="replace"):
            return uml
    return Qemu()


def run(command: Sequence[str], console: Path, timeout_s: float) -> None:
    """Run a guest, its console going to a file, until it ends; none of its processes stays.

    Raises `TimeoutError`.
    """
    environment = {**os.environ, "TMPDIR": str(_memory())}
    with console.open("wb") as output:
        process = subprocess.Popen(
            ["setpriv", "--pdeathsig=KILL", "nice", "-n", "0", *command],
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
        )
        try:
            process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            raise TimeoutError(f"{console}: not over after {timeout_s:.0f} s") from None
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _memory() -> Path:
    """Where the guest's memory lies as a file: in memory where a container allows that much."""
    shared = Path("/dev/shm")
    enough = shared.is_dir() and shutil.disk_usage(shared).free > MEMORY_BYTES
    return shared if enough else CACHE


class Guest:
    """A machine with a disk of its own; what is done in one boot is there in the next."""

    def __init__(self, machine: Machine, folder: Path, payload: Path) -> None:
        """*payload* is a folder that the guest finds under /mnt."""
        self.machine = machine
        self.folder = folder
        self.disk = folder / "disk.img"
        self.payload = folder / "payload.img"
        subprocess.run(
            ["cp", "--sparse=always", build_image(machine.modules), self.disk], check=True
        )
        make_filesystem(self.payload, payload, "payload", "1000M")

    def boot(self, stage: str) -> Path:
        """Boot, let the guest run *stage*, and return the folder of what it left behind.

        Raises `TimeoutError` when the machine does not switch itself off in its time. The exit
        code says nothing: User-Mode Linux ends with 0 even after a kernel panic.
        """
        results = self.folder / f"{stage}.tar"
        with results.open("wb") as file:
            file.truncate(RESULTS_BYTES)
        words = f"root={self.machine.disk(0)} rw panic=-1 armd.stage={stage} "
        words += f"armd.results={self.machine.disk(2)} systemd.journald.forward_to_console=1"
        command = self.machine.command([self.disk, self.payload, results], words)
        run(command, self.folder / f"{stage}.console", self.machine.stage_s)
        left = self.folder / stage
        with tarfile.open(results) as archive:
            archive.extractall(left, filter="data")
        return left

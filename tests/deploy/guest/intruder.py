"""Runs in the daemon's place, under the daemon's unit, and tries what it must not be able to do."""

from __future__ import annotations

import ctypes
import importlib.util
import mmap
import os
import resource
import socket
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

LIBC = ctypes.CDLL(None, use_errno=True)
CLONE_NEWUSER = 0x10000000
EXECUTABLE = mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC


def call(name: str, *arguments: object) -> None:
    if getattr(LIBC, name)(*arguments) != 0:
        raise OSError(ctypes.get_errno(), name)


def see_other_processes() -> None:
    if not Path("/proc/1/status").exists():
        raise PermissionError("hidden")


def listen_on_every_interface() -> None:
    """Binding is allowed; a packet from outside loopback must not get in or out."""
    with socket.create_server(("192.0.2.1", 7448)), socket.socket() as client:
        client.settimeout(2)
        client.bind(("192.0.2.1", 0))
        client.connect(("192.0.2.1", 7448))


def make_set_uid_file() -> None:
    with tempfile.NamedTemporaryFile(dir="/var/lib/armd") as file:
        Path(file.name).chmod(0o4755)


def fork_without_end() -> None:
    children = []
    try:
        for _ in range(300):
            child = os.fork()
            if child == 0:
                time.sleep(30)
                os._exit(0)
            children.append(child)
    finally:
        for child in children:
            os.kill(child, 9)
            os.waitpid(child, 0)


ATTEMPTS: dict[str, Callable[[], object]] = {
    "write /etc": lambda: Path("/etc/armd/intruder").write_text(""),
    "write /usr": lambda: Path("/usr/intruder").write_text(""),
    "write /opt/armd": lambda: Path("/opt/armd/intruder").write_text(""),
    "write /var": lambda: Path("/var/intruder").write_text(""),
    "read /home": lambda: list(Path("/home").iterdir()),
    "read /root": lambda: list(Path("/root").iterdir()),
    "open another serial port": lambda: os.open("/dev/open-serial", os.O_RDWR | os.O_NOCTTY),
    "open a disk": lambda: os.open("/dev/open-disk", os.O_RDONLY),
    "open the kernel's log": lambda: os.open("/dev/kmsg", os.O_RDONLY),
    "see other processes": see_other_processes,
    "send raw packets": lambda: socket.socket(socket.AF_PACKET, socket.SOCK_RAW),
    "speak to the network": listen_on_every_interface,
    "make a user namespace": lambda: call("unshare", CLONE_NEWUSER),
    "mount": lambda: call("mount", b"none", b"/tmp", b"tmpfs", 0, None),
    "set the clock": lambda: time.clock_settime(time.CLOCK_REALTIME, 0),
    "set the host's name": lambda: call("sethostname", b"x", 1),
    "become root": lambda: os.setuid(0),
    "make a set-uid file": make_set_uid_file,
    "take real-time priority": lambda: os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10)),
    "fork without end": fork_without_end,
    "execute what it wrote": lambda: mmap.mmap(-1, 4096, prot=EXECUTABLE),
    "dump core": lambda: resource.setrlimit(resource.RLIMIT_CORE, (1, 1)),
}


def main() -> None:
    if importlib.util.find_spec("numba"):  # which may have to compile: deploy/compiles.conf
        del ATTEMPTS["execute what it wrote"]
    with Path("/var/lib/armd/intruder.txt").open("w") as report:
        for name, attempt in ATTEMPTS.items():
            try:
                attempt()
            except FileNotFoundError as error:  # not tried at all
                print(f"POSSIBLE {name}: {error}", file=report)
            except (OSError, ValueError) as error:
                print(f"FORBIDDEN {name}: {error}", file=report)
            else:
                print(f"POSSIBLE {name}", file=report)


if __name__ == "__main__":
    main()

"""A pseudo-terminal that behaves like a UART: a host that does not read in time loses packets."""

from __future__ import annotations

import os
import select
import time
from pathlib import Path

from armd.errors import BadInput

try:
    import fcntl
    import termios
    import tty
except ImportError:  # Windows: the simulator only writes sessions
    HAS_TERMINALS = False
else:
    HAS_TERMINALS = True

TRANSITS = 50  # number of measurements; the quickest tenth gives the least time


class PtyPort:
    """The arm's end of a serial line.

    A pty buffers some 20 kB and then blocks its writer; a UART does not wait. So writes never
    block, and packets that do not fit are dropped whole. The slave end is held open: otherwise the
    writer would see an error whenever no host has it open.

    *link*: a symbolic link to the slave, made again at every `plug`, so that the path stays the
    same after an unplugging, like a name in /dev/serial/by-id.
    """

    def __init__(self, link: Path | None = None) -> None:
        if not HAS_TERMINALS:
            raise BadInput("the simulator", "its port", "a system without terminals", "Linux")
        self._link = link
        self.path = ""
        self._plugged = False
        self._unsent = b""
        self.plug()

    @property
    def plugged(self) -> bool:
        return self._plugged

    @property
    def baud(self) -> int:
        """The rate that the host has set; the arm must keep to it, because a pty does not."""
        speed = termios.tcgetattr(self._slave)[5]
        name = next(
            (
                n
                for n in vars(termios)
                if n[:1] == "B" and n[1:].isdigit() and getattr(termios, n) == speed
            ),
            "B38400",
        )
        return int(name[1:]) or 38_400

    def plug(self) -> None:
        """Appear, with the same /dev/pts number as before if that is free."""
        earlier_path, spare = self.path, []
        self._open()
        # The kernel gives the lowest free number: hold the lower ones until ours comes up.
        while (
            earlier_path
            and self.path != earlier_path
            and _number(self.path) < _number(earlier_path)
        ):
            spare += [self._master, self._slave]
            self._open()
        for descriptor in spare:
            os.close(descriptor)
        self._plugged = True
        if self._link is not None:
            fresh = self._link.with_name(f".{self._link.name}.new")
            fresh.unlink(missing_ok=True)
            fresh.symlink_to(self.path)
            fresh.replace(self._link)

    def unplug(self) -> None:
        """Disappear: a host that has the port open reads an error."""
        if self._plugged:
            self._plugged = False
            self._unsent = b""
            if self._link is not None:  # first, as the pty's number may be used again at once
                self._link.unlink(missing_ok=True)
            os.close(self._slave)
            os.close(self._master)

    close = unplug

    def write(self, packets: bytes) -> bool:
        """Send whole packets; return False if there was no room and they were dropped."""
        if self._unsent:
            self._unsent = self._unsent[self._push(self._unsent) :]
            if self._unsent:
                return False
        done = self._push(packets)
        if done:
            self._unsent = packets[done:]  # never half a packet: the rest is sent first next time
        return done > 0

    def drain(self, timeout_s: float) -> None:
        """Wait until the host has read everything, but no longer than *timeout_s*."""
        deadline = time.monotonic() + timeout_s
        while self._plugged and time.monotonic() < deadline:
            time.sleep(0.01)  # the kernel passes bytes on with a delay
            unread = fcntl.ioctl(self._slave, termios.FIONREAD, b"\0" * 4)
            if not any(unread):
                return

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that the host has sent; wait up to *timeout_s* for some."""
        ready, _, _ = select.select([self._master], [], [], timeout_s)
        return os.read(self._master, 4096) if ready else b""

    def _open(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)

    def _push(self, data: bytes) -> int:
        try:
            return os.write(self._master, data)
        except BlockingIOError:
            return 0


def measure_transit_ns() -> int:
    """Measure the least time of a few bytes through a pseudo-terminal of this machine.

    It is from the host's write until a waiting simulator has them.
    """
    port = PtyPort()
    host = os.open(port.path, os.O_RDWR | os.O_NOCTTY)
    taken_ns: list[int] = []
    for _ in range(TRANSITS):
        time.sleep(0.001)  # as between two requests: the reader sleeps
        began_ns = time.monotonic_ns()
        os.write(host, b"request")
        port.read(1.0)
        taken_ns.append(time.monotonic_ns() - began_ns)
    os.close(host)
    port.close()
    return sorted(taken_ns)[TRANSITS // 10]


def _number(path: str) -> int:
    return int(path.rpartition("/")[2])

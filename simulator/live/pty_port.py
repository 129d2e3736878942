"""A pseudo-terminal that behaves like a UART: whoever does not read in time loses packets."""

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
except ImportError:  # Windows, where the simulator writes sessions and plays no arm
    HAS_TERMINALS = False
else:
    HAS_TERMINALS = True

TRANSITS = 50  # of which the quickest tenth tell what no passing takes less than


class PtyPort:
    """The arm's end of a serial line.

    A pty buffers some 20 kB and then blocks its writer; a UART does not wait. So writes never
    block, and what does not fit is dropped in whole packets. The slave end is held open, else
    the writer would see an error whenever nobody has it open.

    *link*: a symbolic link to the slave, made anew at every `plug`, so that the path outlives an
    unplugging as a name in /dev/serial/by-id does.
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
        """What the host has set; a pty does not keep to it, so that the arm must."""
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
        """Appear; on the same /dev/pts number as before wherever that is free again."""
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
        """Disappear: whoever has the port open reads an error."""
        if self._plugged:
            self._plugged = False
            self._unsent = b""
            if self._link is not None:  # first: a closed one's number can be another's at once
                self._link.unlink(missing_ok=True)
            os.close(self._slave)
            os.close(self._master)

    close = unplug

    def write(self, packets: bytes) -> bool:
        """Send whole packets; False if there was no room and they were dropped."""
        if self._unsent:
            self._unsent = self._unsent[self._push(self._unsent) :]
            if self._unsent:
                return False
        done = self._push(packets)
        if done:
            self._unsent = packets[done:]  # never half a packet: the rest goes first next time
        return done > 0

    def drain(self, timeout_s: float) -> None:
        """Wait until the host has read everything, but no longer than *timeout_s*."""
        deadline = time.monotonic() + timeout_s
        while self._plugged and time.monotonic() < deadline:
            time.sleep(0.01)  # the kernel hands bytes over in its own time
            unread = fcntl.ioctl(self._slave, termios.FIONREAD, b"\0" * 4)
            if not any(unread):
                return

    def read(self, timeout_s: float) -> bytes:
        """What the host has sent; waits up to *timeout_s* for something."""
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
    """What a few bytes take at the least through a pseudo-terminal of this machine, from the host's
    write until a simulator that waits for them has them."""
    port = PtyPort()
    host = os.open(port.path, os.O_RDWR | os.O_NOCTTY)
    taken_ns: list[int] = []
    for _ in range(TRANSITS):
        time.sleep(0.001)  # as between two requests: whoever is to wake sleeps
        began_ns = time.monotonic_ns()
        os.write(host, b"request")
        port.read(1.0)
        taken_ns.append(time.monotonic_ns() - began_ns)
    os.close(host)
    port.close()
    return sorted(taken_ns)[TRANSITS // 10]


def _number(path: str) -> int:
    return int(path.rpartition("/")[2])

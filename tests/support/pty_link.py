"""A pseudo-terminal behind a symbolic link, which may be pulled out and plugged in again."""

from __future__ import annotations

import os
import pty
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def open_line() -> Iterator[tuple[int, int, str]]:
    """Both ends of a pseudo-terminal that changes no byte, and the path of the second."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    try:
        yield master, slave, os.ttyname(slave)
    finally:
        os.close(master)
        os.close(slave)


class PtyLink:
    """*master*: the device's end, −1 while unplugged; the host opens *link*."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.master = -1
        self.plug()

    def plug(self) -> None:
        master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        fresh = self.link.with_suffix(".new")
        fresh.symlink_to(os.ttyname(slave))
        fresh.rename(self.link)
        self._slave, self.master = slave, master

    def unplug(self) -> None:
        self.link.unlink()
        master, self.master = self.master, -1
        os.close(self._slave)
        os.close(master)

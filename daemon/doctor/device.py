"""Check whether a path can be a serial port.

A file, /dev/null or a terminal screen cannot be one; then it does not matter which process holds
it.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from armd.daemon.doctor.finding import PortReport

LISTED = "`ls -l /dev/serial/by-id` names what is plugged in"
KINDS = {
    stat.S_IFREG: "a file",
    stat.S_IFDIR: "a folder",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFBLK: "a disk",
}
CONTROLLING = os.makedev(5, 0)  # /dev/tty
#: Errors of opening a real serial port; later checks find the process or permission behind them.
MAY_BE_ONE = (errno.EBUSY, errno.EAGAIN, errno.EACCES, errno.EPERM)


def may_be_a_port(port: Path, report: PortReport) -> bool:
    """Return whether *port* exists and may be a serial port.

    If not, *report* gets a finding that says what it is.
    """
    try:
        mode = port.stat().st_mode
    except FileNotFoundError:
        report.find("no_port", *_describe_missing(port))
        return False
    except OSError as error:  # a folder without permission, a loop of links
        report.find("no_port", f"{port} cannot be looked at: {error.strerror}", f"namei -l {port}")
        return False
    kind = (
        _describe_character(port)
        if stat.S_ISCHR(mode)
        else KINDS.get(stat.S_IFMT(mode), "no device")
    )
    if kind:
        text = f"{port} is {kind}, no serial port"
        report.find("no_serial_port", text, f"give the arm's own port: {LISTED}")
    return not kind


def _describe_missing(port: Path) -> tuple[str, str]:
    """Return a description of the missing port, and a remedy."""
    if not port.is_symlink():
        return f"{port} is not there", f"plug the arm in; {LISTED}"
    target = port.readlink()
    text = f"{port} points to {target}, which is gone"
    if target.parent.name == "pts":
        return text, "start the program that made this pseudo-terminal again"
    return text, f"plug the arm in, or give its present port; {LISTED}"


def _describe_character(device: Path) -> str:
    """Describe a character device that is not a serial port; "" for one that may be."""
    try:
        fd = os.open(device, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        may_be = error.errno in MAY_BE_ONE
        return "" if may_be else f"a device that does not open ({error.strerror})"
    try:
        if not os.isatty(fd):
            return "another kind of device"
        device_number = os.fstat(fd).st_rdev
        ours = [os.fstat(i).st_rdev for i in (0, 1, 2) if os.isatty(i)]
        return "the screen in front of you" if device_number in (CONTROLLING, *ours) else ""
    finally:
        os.close(fd)

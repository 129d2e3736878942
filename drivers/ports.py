"""Serial ports of this machine, by names that stay the same when they are plugged in again."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path


def list_serial_ports(dev: Path = Path("/dev")) -> list[Path]:
    """List every USB serial adapter once, by its name under /dev/serial/by-id where it has one."""
    named = {path.resolve(): path for path in sorted((dev / "serial/by-id").glob("*"))}
    devices = sorted([*dev.glob("ttyUSB*"), *dev.glob("ttyACM*")])
    return [named.get(device.resolve(), device) for device in devices]


def is_pseudo(descriptor: int) -> bool:
    """Return whether a port is a pseudo-terminal: a bridge to a machine, or a simulated arm."""
    with suppress(OSError):  # not a terminal
        return os.ttyname(descriptor).startswith("/dev/pts/")
    return False

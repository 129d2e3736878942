"""Carry bytes between the simulated arm's port and the far end of the controller's.

What the other side does not take in time is dropped, as on a wire.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import sys
import time
import tty

from plug import plug


def main(port: str) -> None:
    arm = _open(port)
    controller = os.open(plug().far_end, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    notify = os.environ["NOTIFY_SOCKET"]
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.sendto(b"READY=1", notify)
    while True:
        for source in select.select([arm, controller], [], [], 1.0)[0]:
            try:
                data = os.read(source, 4096)
            except OSError:  # nobody has opened the controller's port
                time.sleep(0.01)
                continue
            with contextlib.suppress(BlockingIOError):
                os.write(controller if source == arm else arm, data)


def _open(port: str) -> int:
    while True:
        with contextlib.suppress(FileNotFoundError):
            file = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            tty.setraw(file)
            return file
        time.sleep(0.1)


if __name__ == "__main__":
    main(sys.argv[1])

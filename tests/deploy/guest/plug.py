"""The arm's plug, pulled and put back: what is the kernel's and udev's part of it is real.

`python3 plug.py in|out` for the units; the checks import it.
"""

from __future__ import annotations

import sys
from pathlib import Path

from controller import sh, wait_for


class PseudoTerminal:
    """User-Mode Linux has no USB. A BSD pseudo-terminal is, unlike others, a device that udev
    knows; as nothing is really pulled, its events are triggered."""

    far_end = Path("/dev/ptya0")

    def put(self, there: bool) -> None:
        action = "add" if there else "remove"
        sh(f"udevadm trigger --settle --action={action} /sys/class/tty/ttya0")


class Usb:
    """qemu's FTDI adapter: what the kernel no longer admits goes through its drivers and udev as
    what was pulled."""

    far_end = Path("/dev/virtio-ports/arm")
    admitted = Path("/sys/bus/usb/devices/1-1/authorized")

    def put(self, there: bool) -> None:
        if self.is_in() != there:
            self.admitted.write_text(str(int(there)))
            name = Path("/dev/armd/SIM-0001")
            wait_for(lambda: name.exists() == there, 60, f"{name} {'there' if there else 'gone'}")
        sh("udevadm settle")

    def is_in(self) -> bool:
        return self.admitted.read_text().strip() == "1"


def plug() -> PseudoTerminal | Usb:
    return PseudoTerminal() if PseudoTerminal.far_end.exists() else Usb()


if __name__ == "__main__":
    plug().put(sys.argv[1] == "in")

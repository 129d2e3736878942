"""Keep the processors awake while an arm sends, where the system allows it.

A processor that sleeps between two samples is woken four times for each of them: by the line, by
the daemon, by Zenoh here and by Zenoh at the subscriber. Linux's request for a quick wake-up (PM
QoS, Documentation/power/pm_qos_interface.rst) lasts as long as its file is open.
"""

from __future__ import annotations

import os
import struct
from contextlib import suppress
from pathlib import Path

DEVICE = Path("/dev/cpu_dma_latency")
IDLE_DRIVER = Path("/sys/devices/system/cpu/cpuidle/current_driver")
#: µs: allows the lightest sleep of a processor (C1), and none of the deeper ones.
LIGHT_SLEEP_US = 2
#: In a virtual machine even the lightest sleep exits to the host, which takes longer than stated.
NO_SLEEP_US = 0


class Awake:
    """The request to stay awake, off at first.

    Without permission for the device (udev/71-armd-awake.rules) it stays off.
    """

    def __init__(self, device: Path = DEVICE, idle_driver: Path = IDLE_DRIVER) -> None:
        self._device = device
        self._idle_driver = idle_driver
        self._is_requested = False
        self._open: int | None = None

    def keep(self, is_requested: bool) -> None:
        """Make or withdraw the request; calling it often does no harm."""
        if is_requested == self._is_requested:
            return
        self._is_requested = is_requested
        if is_requested:
            with suppress(OSError):
                self._open = os.open(self._device, os.O_WRONLY | os.O_CLOEXEC)
                os.write(self._open, struct.pack("=i", self._latency_us()))
        elif self._open is not None:
            os.close(self._open)
            self._open = None

    def _latency_us(self) -> int:
        with suppress(OSError):
            if self._idle_driver.read_text().strip() == "haltpoll":  # a virtual machine
                return NO_SLEEP_US
        return LIGHT_SLEEP_US

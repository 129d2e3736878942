"""The table of drivers, by the `kind` that armd.toml names.

A module is imported when it is chosen. Other kinds are those of other packages
(docs/developer/plugins.md).
"""

from __future__ import annotations

import logging
from importlib import import_module
from typing import TYPE_CHECKING

from armd.drivers.config import DriverConfig
from armd.drivers.identity import Expectation
from armd.drivers.sample import Driver

if TYPE_CHECKING:
    from armd.drivers.plugin import DriverPlugin

_log = logging.getLogger(__name__)

DRIVERS = {
    "serial": "armd.drivers.serial.port:SerialDriver",
    "can": "armd.drivers.can.driver:CanDriver",
    "feetech": "armd.drivers.poll.driver:ServoDriver",
    "dynamixel": "armd.drivers.poll.driver:ServoDriver",
    "dynamixel1": "armd.drivers.poll.driver:ServoDriver",
    "microscribe": "armd.drivers.microscribe.driver:MicroScribeDriver",
    "replay": "armd.drivers.replay.driver:ReplayDriver",
}


def open_driver(config: DriverConfig | DriverPlugin, expectation: Expectation) -> Driver:
    """Open the driver that *config* names. `Driver.read` waits for missing hardware."""
    _log.info("opening the driver %s", config.kind)
    module, name = DRIVERS.get(config.kind, "armd.drivers.plugin:GuardedDriver").split(":")
    driver: Driver = getattr(import_module(module), name)(config, expectation)
    driver.open()
    return driver

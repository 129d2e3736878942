"""The channels of all temperature modules: values in three PDOs, their validity in a fourth."""

from __future__ import annotations

import math

import numpy as np

from armd.arrays import F64
from armd.drivers.can import objects as can


class Thermometers:
    """The temperatures of *n_sensors* channels in °C; each reading is complete and new, or NaN."""

    def __init__(self, n_sensors: int) -> None:
        self.nodes = can.TEMPERATURE_NODES[: math.ceil(n_sensors / can.CHANNELS_PER_MODULE)]
        self._n_sensors = n_sensors
        self._celsius = np.full((len(self.nodes), can.CHANNELS_PER_MODULE), np.nan)
        self._arriving = self._celsius.copy()  # values whose status has not come yet

    def take(self, node: int, pdo: int, data: bytes) -> F64 | None:
        """Take TPDO *pdo* of module *node*; return all channels (n_sensors,) if a reading is
        complete.

        Raises ValueError where the length is wrong.
        """
        module = self.nodes.index(node)
        if len(data) != (can.STATUS_PDO if pdo == can.STATUS_PDO_NUMBER else can.VALUES_PDO).size:
            raise ValueError(f"TPDO{pdo} of {len(data)} bytes")
        if pdo < can.STATUS_PDO_NUMBER:
            first = can.CHANNELS_PER_PDO * (pdo - 1)
            values = np.array(can.VALUES_PDO.unpack(data)) * can.PROCESS_VALUE_UNIT_C
            self._arriving[module, first : first + can.CHANNELS_PER_PDO] = values
            return None
        invalid = np.array(can.STATUS_PDO.unpack(data)) & 1
        self._celsius[module] = np.where(invalid == 1, np.nan, self._arriving[module])
        self._arriving[module] = np.nan  # the next reading must be new
        return self._celsius.ravel()[: self._n_sensors].copy()

    def lose(self, node: int) -> None:
        """Set the channels of a failed module *node* to NaN."""
        self._celsius[self.nodes.index(node)] = np.nan

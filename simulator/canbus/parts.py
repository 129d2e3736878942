"""The nodes of an arm: CiA 406 encoders and CiA 404 temperature modules."""

from __future__ import annotations

from importlib.resources import files

import numpy as np

from armd.arrays import F64
from armd.drivers.can import objects as can
from armd.simulator.canbus.node import SimulatedNode
from armd.simulator.live.electronics import COUNTS_PER_TURN

EDS = files("armd.drivers.can") / "eds"


class Encoder(SimulatedNode):
    """The absolute encoder of joint k: node k."""

    def __init__(self, node_id: int, counts_per_turn: int = COUNTS_PER_TURN) -> None:
        self.count = 0
        self._turn = counts_per_turn
        self.alarms = 0
        self.warnings = 0
        super().__init__(node_id, EDS / "encoder.eds", tpdos=1)

    def read_measured(self, index: int, sub_index: int) -> int | None:
        match index:
            case can.POSITION:
                return self.count
            case can.ALARMS:
                return self.alarms
            case can.WARNINGS:
                return self.warnings
            case can.UNITS_PER_TURN | can.TOTAL_RANGE | can.PHYSICAL_RESOLUTION:
                return None if self._turn == COUNTS_PER_TURN else self._turn  # as in the EDS
        return super().read_measured(index, sub_index)


class Thermometer(SimulatedNode):
    """A module of six channels; those without a sensor, or with a broken one, are invalid."""

    def __init__(self, node_id: int) -> None:
        self.celsius: F64 = np.full(can.CHANNELS_PER_MODULE, np.nan)
        super().__init__(node_id, EDS / "temperature.eds", tpdos=4)

    def read_measured(self, index: int, sub_index: int) -> int | None:
        if index not in (can.PROCESS_VALUE, can.CHANNEL_STATUS) or sub_index == 0:
            return super().read_measured(index, sub_index)
        celsius = float(self.celsius[sub_index - 1])
        invalid = bool(np.isnan(celsius))
        if index == can.CHANNEL_STATUS:
            return int(invalid)
        return 0 if invalid else round(celsius / can.PROCESS_VALUE_UNIT_C)

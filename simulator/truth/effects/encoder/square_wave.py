"""An encoder that uses a coarser track over every other part of the turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect
from armd.simulator.truth.rotations import ARC_SECOND


@dataclass(frozen=True)
class SquareWave(Effect):
    joint: int
    periods: int  # a turn
    amplitude_arcsec: float
    phase: float  # rad

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        side = np.sign(np.sin(self.periods * phi[:, joint - 1] + self.phase))
        error: F64 = self.amplitude_arcsec * ARC_SECOND * side
        return error

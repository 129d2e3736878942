"""An encoder that loses its index at an instant and continues from another count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect
from armd.simulator.truth.rotations import ARC_SECOND


@dataclass(frozen=True)
class LostIndex(Effect):
    joint: int
    step_arcsec: float
    instant_s: float  # since the arm was mounted

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        return np.where(conditions.time_s >= self.instant_s, self.step_arcsec * ARC_SECOND, 0.0)

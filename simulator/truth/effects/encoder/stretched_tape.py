"""An encoder tape stretched round its drum: it counts too many, or too few, lines a radian."""

from __future__ import annotations

from dataclasses import dataclass

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect
from armd.simulator.truth.rotations import ARC_SECOND


@dataclass(frozen=True)
class StretchedTape(Effect):
    joint: int
    arcsec_per_rad: float

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        # The tape's own pitch: lines passed × nominal angle of a line.
        pitch = 1.0 / (1.0 + self.arcsec_per_rad * ARC_SECOND)
        return phi[:, joint - 1] / pitch - phi[:, joint - 1]

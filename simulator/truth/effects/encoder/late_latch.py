"""A joint whose encoder is latched late: it shows a slightly later angle."""

from __future__ import annotations

from dataclasses import dataclass

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect


@dataclass(frozen=True)
class LateLatch(Effect):
    joint: int
    delay_us: float

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        return 1e-6 * self.delay_us * conditions.rate[:, joint - 1]

"""A stylus that was removed and refitted: its tip is displaced in the last frame from then on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect, Posture


@dataclass(frozen=True)
class RefittedTip(Effect):
    shift_um: tuple[float, float, float]
    instant_s: float = -np.inf  # since the arm was mounted

    def tip(self, posture: Posture, conditions: Conditions) -> F64 | None:
        shift = posture.rotation[-1] @ (1e-3 * np.array(self.shift_um))
        refitted: F64 = np.where((conditions.time_s >= self.instant_s)[:, None], shift, 0.0)
        return refitted

"""A mount that creeps, or moves at one instant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.simulator.truth.effects.effect import Conditions, Effect, SmallMotion
from armd.simulator.truth.rotations import ARC_SECOND

HOUR_S = 3600.0


@dataclass(frozen=True)
class MovingMount(Effect):
    """A moving mount; `turn_arcsec` and `shift_um` are per hour for a creep, total for a step."""

    turn_arcsec: tuple[float, float, float]
    shift_um: tuple[float, float, float]
    since_s: float = 0.0  # when the creep began, since the arm was mounted
    step_at_s: float | None = None  # since the arm was mounted; None: a creep

    def base(self, conditions: Conditions) -> SmallMotion | None:
        if self.step_at_s is None:
            how_far = (conditions.time_s - self.since_s) / HOUR_S
        else:
            how_far = (conditions.time_s >= self.step_at_s).astype(np.float64)
        turn = np.array(self.turn_arcsec) * ARC_SECOND
        shift = 1e-3 * np.array(self.shift_um)
        return SmallMotion(how_far[:, None] * turn, how_far[:, None] * shift)

"""A bearing whose races are not true: the axis tilts and shifts as it turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.simulator.truth.effects.effect import Conditions, Effect, Posture, SmallMotion
from armd.simulator.truth.rotations import ARC_SECOND


@dataclass(frozen=True)
class WobblingAxis(Effect):
    """An axis that wobbles once or twice a turn.

    Once: the outer race is skew and the axis rocks about one line fixed in the housing. Twice: the
    inner race is oval and the axis circles a cone, two turns for one.
    """

    joint: int
    tilt_arcsec: float
    run_out_um: float
    order: int  # 1 or 2
    phase: float  # rad
    line: float  # direction of the rocking line in the housing, rad

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        if joint != self.joint:
            return None
        phase_rad = self.order * posture.phi[:, joint - 1] + self.phase
        if self.order == 1:
            across = np.column_stack(
                [np.full(len(phase_rad), f(self.line)) for f in (np.cos, np.sin)]
            )
            across *= np.cos(phase_rad)[:, None]
        else:
            across = np.column_stack([np.cos(phase_rad), np.sin(phase_rad)])
        flat = np.column_stack([across, np.zeros(len(phase_rad))])
        return SmallMotion(self.tilt_arcsec * ARC_SECOND * flat, 1e-3 * self.run_out_um * flat)

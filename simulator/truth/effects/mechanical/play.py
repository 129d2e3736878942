"""Play between a joint's shaft and its link: friction keeps the link on the side from which it
came.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.simulator.truth.effects.effect import Conditions, Effect, Posture, SmallMotion
from armd.simulator.truth.rotations import ARC_SECOND

#: Below this rate friction does not press the play to its end, rad/s.
CREEP_RAD_S = 2e-5


@dataclass(frozen=True)
class Play(Effect):
    joint: int
    half_width_arcsec: float

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        if joint != self.joint:
            return None
        # The shaft turns first and the link follows, so it is short of the encoder's angle.
        side = np.tanh(conditions.rate[:, joint - 1] / CREEP_RAD_S)
        return SmallMotion.about_own_axis(-self.half_width_arcsec * ARC_SECOND * side)

"""A joint that gives under the weight of what it carries, beyond its encoder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.simulator.truth.conditions import Conditions
from armd.simulator.truth.effects.base import Effect
from armd.simulator.truth.posture import Posture
from armd.simulator.truth.rotations import Motion


@dataclass(frozen=True)
class SoftJoint(Effect):
    joint: int
    rad_per_nm: float

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> Motion | None:
        if joint != self.joint:
            return None
        turn = np.zeros((len(posture.phi), 3))
        turn[:, 2] = self.rad_per_nm * posture.torque(joint)
        return Motion(turn, np.zeros_like(turn))

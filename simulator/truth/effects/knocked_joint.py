"""A joint knocked in transport: its link is no longer where the calibration found it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.simulator.truth.conditions import Conditions
from armd.simulator.truth.effects.base import Effect
from armd.simulator.truth.posture import Posture
from armd.simulator.truth.rotations import Motion


@dataclass(frozen=True)
class KnockedJoint(Effect):
    """The link is turned and shifted once and for all, in the frame that turns with its joint."""

    joint: int
    turn_rad: tuple[float, float, float]
    shift_mm: tuple[float, float, float]

    def link(self, link: int, posture: Posture, conditions: Conditions) -> Motion | None:
        if link != self.joint:
            return None
        n = len(posture.tip)
        return Motion(np.tile(self.turn_rad, (n, 1)), np.tile(self.shift_mm, (n, 1)))

"""A joint knocked in transport: its link is no longer where it was at the calibration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.simulator.truth.effects.effect import Conditions, Effect, Posture, SmallMotion


@dataclass(frozen=True)
class KnockedJoint(Effect):
    """A link that slipped on its joint's hub (turn about z), and is bent or shifted at its end.

    It is permanent, in the frame that turns with its joint.
    """

    joint: int
    turn_rad: tuple[float, float, float]
    shift_mm: tuple[float, float, float]

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        if joint != self.joint:
            return None
        n = len(posture.tip)
        return SmallMotion(np.tile((0.0, 0.0, self.turn_rad[2]), (n, 1)), np.zeros((n, 3)))

    def link(self, link: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        if link != self.joint:
            return None
        n = len(posture.tip)
        return SmallMotion(
            np.tile((*self.turn_rad[:2], 0.0), (n, 1)), np.tile(self.shift_mm, (n, 1))
        )

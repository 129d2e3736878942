"""A joint that yields to its load's weight, beyond its encoder."""

from __future__ import annotations

from dataclasses import dataclass

from armd.simulator.truth.effects.effect import Conditions, Effect, Posture, SmallMotion


@dataclass(frozen=True)
class SoftJoint(Effect):
    joint: int
    rad_per_nm: float

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        if joint != self.joint:
            return None
        return SmallMotion.about_own_axis(self.rad_per_nm * posture.torque(joint))

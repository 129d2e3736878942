"""An imperfection whose form is not quite the textbook's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect, Posture, SmallMotion


@dataclass(frozen=True)
class Distorted(Effect):
    """Another effect, stronger and weaker twice a turn of a joint: off by *share* in the RMS.

    Effects of time or temperature only (a mount, an expansion) keep their form.
    """

    effect: Effect
    share: float
    joint: int
    phase: float  # rad

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        error = self.effect.encoder_error_rad(joint, phi, conditions)
        return None if error is None else self._factor(phi) * error

    def base(self, conditions: Conditions) -> SmallMotion | None:
        return self.effect.base(conditions)

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        return self._scaled(self.effect.axis(joint, posture, conditions), posture)

    def link(self, link: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        return self._scaled(self.effect.link(link, posture, conditions), posture)

    def strain(self, link: int, conditions: Conditions) -> F64 | None:
        return self.effect.strain(link, conditions)

    def tip(self, posture: Posture, conditions: Conditions) -> F64 | None:
        displacement = self.effect.tip(posture, conditions)
        return None if displacement is None else self._factor(posture.phi)[:, None] * displacement

    def _scaled(self, motion: SmallMotion | None, posture: Posture) -> SmallMotion | None:
        if motion is None:
            return None
        factor = self._factor(posture.phi)[:, None]
        return SmallMotion(factor * motion.turn_rad, factor * motion.shift_mm)

    def _factor(self, phi: F64) -> F64:
        wave = np.sqrt(2.0) * np.cos(2 * phi[:, self.joint - 1] + self.phase)
        factor: F64 = 1.0 + self.share * wave
        return factor

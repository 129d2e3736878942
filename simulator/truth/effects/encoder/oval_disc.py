"""An encoder disc clamped out of round."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect
from armd.simulator.truth.rotations import ARC_SECOND


@dataclass(frozen=True)
class OvalDisc(Effect):
    """A disc squeezed along one direction, so that its lines follow an ellipse."""

    joint: int
    amplitude_arcsec: float  # of the angle error, which has two periods a turn
    direction: float  # direction of the long axis, rad

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        # Half the relative difference of the axes is the error's amplitude.
        squeeze = 1.0 + 2.0 * self.amplitude_arcsec * ARC_SECOND
        angle_rad = phi[:, joint - 1] + self.direction
        reading = np.arctan2(squeeze * np.sin(angle_rad), np.cos(angle_rad))
        error: F64 = np.angle(np.exp(1j * (reading - angle_rad)))
        return error

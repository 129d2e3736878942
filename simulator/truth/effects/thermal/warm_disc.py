"""An encoder's disc whose glue creeps with temperature, so that its eccentricity grows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect
from armd.simulator.truth.nominal import GRATING_RADIUS_MM, REFERENCE_C


@dataclass(frozen=True)
class WarmDisc(Effect):
    """A disc whose centre moves off the axis in one direction, by `um_per_k` a kelvin."""

    joint: int
    um_per_k: float
    direction: float  # rad

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        offset_mm = 1e-3 * self.um_per_k * (conditions.link_c[:, joint - 1] - REFERENCE_C)
        turned = phi[:, joint - 1] + self.direction
        bearing: F64 = np.arctan2(
            offset_mm * np.sin(turned), GRATING_RADIUS_MM - offset_mm * np.cos(turned)
        )
        return bearing

"""An encoder disc whose centre is not on the axis."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect
from armd.simulator.truth.nominal import GRATING_RADIUS_MM


@dataclass(frozen=True)
class EccentricDisc(Effect):
    """A disc whose centre circles the axis before one read head."""

    joint: int
    offset_um: float
    direction: float  # direction of the offset on the disc, rad

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        # The head is at (R, 0); the centre at e·(cos, sin) of the turned direction. The reading is
        # the head's bearing from the disc's centre, which would be 0 from the axis.
        turned = phi[:, joint - 1] + self.direction
        offset_mm = 1e-3 * self.offset_um
        bearing = np.arctan2(
            -offset_mm * np.sin(turned), GRATING_RADIUS_MM - offset_mm * np.cos(turned)
        )
        error: F64 = -bearing
        return error

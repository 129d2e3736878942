"""A joint's housing that turns its encoder's head, or tilts, as it warms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect
from armd.simulator.truth.nominal import REFERENCE_C
from armd.simulator.truth.rotations import ARC_SECOND

#: Radius at which the read head is held, and length of the bracket that holds it, mm.
HEAD_RADIUS_MM, BRACKET_MM = 25.0, 12.0


@dataclass(frozen=True)
class WarmHousing(Effect):
    """The bracket of the read head grows sideways by its own expansion and its joint's heat."""

    joint: int
    arcsec_per_k: float
    arcsec_per_k2: float = 0.0

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        delta = conditions.link_c[:, joint - 1] - REFERENCE_C
        per_k = self.arcsec_per_k * ARC_SECOND * HEAD_RADIUS_MM / BRACKET_MM
        per_k2 = self.arcsec_per_k2 * ARC_SECOND * HEAD_RADIUS_MM / BRACKET_MM
        sideways = BRACKET_MM * (per_k * delta + per_k2 * delta**2)
        return np.arctan2(sideways, HEAD_RADIUS_MM)

"""Gears between two joints: as one turns, its teeth disturb the other's angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect
from armd.simulator.truth.rotations import ARC_SECOND

#: The second harmonic of the error, from uneven tooth contact, as a share of the first.
FLANKS = 0.2


@dataclass(frozen=True)
class MeshingGears(Effect):
    """The error of a wheel on the other joint, whose run-out drives the encoder of `joint`.

    The run-out has `waves` a turn of `other_joint`. `ratio`: the share of the joint's own turn (a
    differential).
    """

    joint: int
    other_joint: int
    waves: int  # a turn of the other joint
    arcsec: float
    phase: float  # rad
    ratio: float = 0.0

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        rolled = phi[:, self.other_joint - 1] + self.ratio * phi[:, joint - 1]
        phase_rad = self.waves * rolled + self.phase
        error: F64 = np.sin(phase_rad) + FLANKS * np.sin(2.0 * phase_rad + 1.0)
        return self.arcsec * ARC_SECOND * error

"""Gears between two joints: as one turns, its teeth push the other off its angle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect
from armd.simulator.truth.rotations import ARC_SECOND

#: Tooth flanks meet and part unevenly: the second harmonic of the error, as a share of the first.
FLANKS = 0.2


@dataclass(frozen=True)
class MeshingGears(Effect):
    """The encoder of `joint` counts what a wheel on `other` with a run-out of so many waves a turn
    drives through the mesh; `ratio`: how much of the joint's own turn counts too (a differential).
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

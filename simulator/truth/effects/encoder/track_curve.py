"""An encoder whose track was written with errors: a stable curve over the turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect
from armd.simulator.truth.rotations import ARC_SECOND


@dataclass(frozen=True)
class TrackCurve(Effect):
    """A few errors of the track, each a bell curve over a part of the turn."""

    joint: int
    height_arcsec: tuple[float, ...]
    centre: tuple[float, ...]  # rad
    width: float  # rad

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        error = np.zeros(len(phi))
        for height, centre in zip(self.height_arcsec, self.centre, strict=True):
            away = np.angle(np.exp(1j * (phi[:, joint - 1] - centre)))
            error += height * ARC_SECOND * np.exp(-0.5 * (away / self.width) ** 2)
        return error

"""Interpolation of an encoder whose two signals are not quite sine and cosine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect
from armd.simulator.truth.rotations import ARC_SECOND


@dataclass(frozen=True)
class Interpolation(Effect):
    """The signals of a track with `periods` lines, one of them with an offset."""

    joint: int
    periods: int  # a turn
    amplitude_arcsec: float
    phase: float  # rad

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        # An offset of 1 in signals of amplitude 1 is an error of one radian of a period.
        offset = self.amplitude_arcsec * ARC_SECOND * self.periods
        phase_rad = self.periods * phi[:, joint - 1] + self.phase
        reading = np.arctan2(np.sin(phase_rad), np.cos(phase_rad) + offset)
        error: F64 = np.angle(np.exp(1j * (reading - phase_rad))) / self.periods
        return error

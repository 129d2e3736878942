"""A joint that its own friction warms, beside its sensor: the more it is turned, the warmer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect
from armd.simulator.truth.rotations import ARC_SECOND


@dataclass(frozen=True)
class WarmFromWork(Effect):
    """The bearing takes up heat in proportion to |rate| and gives it off with a time constant;
    its zero turns, or its link grows, with the heat. Rested before each session.

    Sizes are what one radian a second comes to in the end. Until a reading the joint turned at that
    reading's rate since the one before.
    """

    joint: int
    arcsec: float
    ppm: float
    time_constant_s: float

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        return self.arcsec * ARC_SECOND * self._heat(conditions)

    def strain(self, link: int, conditions: Conditions) -> F64 | None:
        if link != self.joint:
            return None
        return 1e-6 * self.ppm * self._heat(conditions)

    def _heat(self, conditions: Conditions) -> F64:
        """In rad/s: the steady rate that would keep it so warm, (n,)."""
        work = np.abs(conditions.rate[:, self.joint - 1])
        heat = np.zeros(len(work))
        for i in range(1, len(work)):
            decay = np.exp(
                -(conditions.time_s[i] - conditions.time_s[i - 1]) / self.time_constant_s
            )
            heat[i] = decay * heat[i - 1] + (1.0 - decay) * work[i]
        return heat


@dataclass(frozen=True)
class WarmNeighbour(Effect):
    """The work of one joint warms another one's link: it lengthens, on its own time scale."""

    joint: int
    other_link: int  # of the link
    ppm: float
    time_constant_s: float

    def strain(self, link: int, conditions: Conditions) -> F64 | None:
        if link != self.other_link:
            return None
        return WarmFromWork(self.joint, 0.0, self.ppm, self.time_constant_s).strain(
            self.joint, conditions
        )

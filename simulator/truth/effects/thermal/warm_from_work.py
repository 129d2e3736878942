"""A joint that its own friction warms by motion, which its sensor does not show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect
from armd.simulator.truth.rotations import ARC_SECOND


@dataclass(frozen=True)
class WarmFromWork(Effect):
    """Friction heat: its zero turns, or its link grows, with the heat of its bearing.

    The bearing takes up heat in proportion to |rate| and loses it with a time constant. It is cold
    at the beginning of each session. Sizes are the final values at one radian a second. Between two
    readings the joint turns at the rate of the later one.
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
        """Return the heat (n,) as the steady rate in rad/s that would sustain it."""
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
    """A joint whose motion warms another joint's link: it lengthens, with a time constant."""

    joint: int
    other_link: int  # number of the link
    ppm: float
    time_constant_s: float

    def strain(self, link: int, conditions: Conditions) -> F64 | None:
        if link != self.other_link:
            return None
        return WarmFromWork(self.joint, 0.0, self.ppm, self.time_constant_s).strain(
            self.joint, conditions
        )

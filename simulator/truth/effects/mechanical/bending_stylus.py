"""A stylus pressed against the target: it bends across, and flattens at the contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect, Posture

#: Share of the contact's flattening in the deflection, the same in every direction.
FLATTENING = 0.25


@dataclass(frozen=True)
class BendingStylus(Effect):
    """A bending stylus; `deflection_um` is that of a push across the stylus."""

    deflection_um: float

    def tip(self, posture: Posture, conditions: Conditions) -> F64 | None:
        stylus = posture.tip - posture.origin[-1]
        stylus = stylus / np.linalg.norm(stylus, axis=1, keepdims=True)
        push = conditions.approach
        across = push - np.sum(push * stylus, axis=1, keepdims=True) * stylus
        behind: F64 = (1 - FLATTENING) * across + FLATTENING * push
        return -1e-3 * self.deflection_um * behind

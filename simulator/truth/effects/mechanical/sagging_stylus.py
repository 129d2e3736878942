"""A long stylus that sags by its own weight."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect, Posture


@dataclass(frozen=True)
class SaggingStylus(Effect):
    """A sagging stylus; `sag_um` is the sag of its tip when level (a cantilever's w·L⁴/8EI).

    Only the part of the weight across it bends it.
    """

    sag_um: float

    def tip(self, posture: Posture, conditions: Conditions) -> F64 | None:
        stylus = posture.tip - posture.origin[-1]
        stylus = stylus / np.linalg.norm(stylus, axis=1, keepdims=True)
        down = np.array([0.0, 0.0, -1.0])
        across: F64 = down - (stylus @ down)[:, None] * stylus
        return 1e-3 * self.sag_um * across

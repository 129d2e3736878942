"""A link of another material than assumed: its lengths follow its temperature differently."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect
from armd.simulator.truth.nominal import REFERENCE_C


@dataclass(frozen=True)
class ExpandingLink(Effect):
    """Extra logarithmic strain `per_k`·ΔT + `per_k2`·ΔT² of a link's lengths."""

    link_number: int
    per_k: float
    per_k2: float = 0.0

    def strain(self, link: int, conditions: Conditions) -> F64 | None:
        if link != self.link_number:
            return None
        delta = conditions.link_c[:, link - 1] - REFERENCE_C
        return np.expm1(self.per_k * delta + self.per_k2 * delta**2)

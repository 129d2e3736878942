"""A link that bows because one side of it is warmer than the other.

Heat that flows from a warm neighbour along a link reaches one side of its tube first. The
difference across is a share of the difference between the two links' temperatures.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.simulator.truth.effects.effect import Conditions, Effect, Posture, SmallMotion


@dataclass(frozen=True)
class BowingLink(Effect):
    link_number: int
    neighbour: int
    curvature: float  # 1/m per kelvin between the two links
    direction: float  # direction of the warm side, about the link, rad

    def link(self, link: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        if link != self.link_number:
            return None
        into = posture.joint_rotation[link - 1].transpose(0, 2, 1)
        span = into @ (posture.origin[link] - posture.origin[link - 1])[:, :, None]
        span = span[:, :, 0]
        length = np.linalg.norm(span, axis=1, keepdims=True)
        along = span / length
        # Two directions across the link that do not depend on the posture.
        helper = np.array([0.0, 1.0, 0.0])
        first = np.cross(along, helper)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        second = np.cross(along, first)
        about = np.cos(self.direction) * first + np.sin(self.direction) * second
        warmer = conditions.link_c[:, link - 1] - conditions.link_c[:, self.neighbour - 1]
        angle = (1e-3 * self.curvature * warmer)[:, None] * length
        # An arc: its end turns by κL and moves aside by (1 − cos κL)/κ ≈ κL²/2.
        aside = length * np.tan(angle / 2)
        return SmallMotion(angle * about, aside * np.cross(about, along))

"""A link as a beam, clamped at its joint, loaded by its own weight and by its load."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import GRAVITY, Conditions, Effect, Posture, SmallMotion


@dataclass(frozen=True)
class BendingLink(Effect):
    """A bending link; `flexibility` is L/EI: its end's turn per Nm of moment there, rad/Nm."""

    link_number: int
    flexibility: float

    def link(self, link: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        if link != self.link_number:
            return None
        span = posture.origin[link] - posture.origin[link - 1]
        length = 1e-3 * np.linalg.norm(span, axis=1, keepdims=True)  # m
        along = 1e-3 * span / length
        force, moment = posture.load(link)
        weight = np.array([0.0, 0.0, -GRAVITY]) * posture.masses.kg[link - 1]
        force, weight = _across(force, along), _across(weight + 0 * force, along)
        moment = _across(moment, along)
        # Cantilever: end force F L³/3EI and F L²/2EI, end moment M L²/2EI and M L/EI, weight
        # spread along it w L⁴/8EI and w L³/6EI. A moment M bends the end towards M × along.
        per = self.flexibility * length  # L²/EI
        sag = per * (force * length / 3 + weight * length / 8 + np.cross(moment, along) / 2)
        turn = self.flexibility * (
            np.cross(along, force * length / 2 + weight * length / 6) + moment
        )
        into = posture.joint_rotation[link - 1].transpose(0, 2, 1)
        return SmallMotion(_turned(into, turn), 1e3 * _turned(into, sag))


def _across(vector: F64, along: F64) -> F64:
    """Return the part of *vector* (n, 3) across the unit vectors *along*."""
    across: F64 = vector - np.sum(vector * along, axis=1, keepdims=True) * along
    return across


def _turned(rotation: F64, vector: F64) -> F64:
    turned: F64 = (rotation @ vector[:, :, None])[:, :, 0]
    return turned

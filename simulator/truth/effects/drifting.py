"""Constants of the arm that drift slowly and smoothly, without a trace in any sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.course import CourseInTime
from armd.simulator.truth.effects.effect import Conditions, Effect, Posture, SmallMotion
from armd.simulator.truth.rotations import ARC_SECOND


@dataclass(frozen=True)
class DriftingZero(Effect):
    """The encoder's zero moves on its hub: glue that creeps, a clamp that relaxes."""

    joint: int
    arcsec: float
    course: CourseInTime

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        return self.arcsec * ARC_SECOND * self.course(conditions.time_s)


@dataclass(frozen=True)
class DriftingLength(Effect):
    """A carbon tube takes up humidity and becomes longer, at any temperature."""

    link_number: int
    ppm: float
    course: CourseInTime

    def strain(self, link: int, conditions: Conditions) -> F64 | None:
        if link != self.link_number:
            return None
        return 1e-6 * self.ppm * self.course(conditions.time_s)


@dataclass(frozen=True)
class DriftingTwist(Effect):
    """A link twists about its long axis, or tilts: resin that creeps under load."""

    link_number: int
    turn_arcsec: tuple[float, float, float]
    course: CourseInTime

    def link(self, link: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        if link != self.link_number:
            return None
        turn = self.course(conditions.time_s)[:, None] * np.array(self.turn_arcsec) * ARC_SECOND
        return SmallMotion(turn, np.zeros_like(turn))


@dataclass(frozen=True)
class DriftingMount(Effect):
    """The base tilts and moves as its clamp settles or the table warms."""

    turn_arcsec: tuple[float, float, float]
    shift_um: tuple[float, float, float]
    course: CourseInTime

    def base(self, conditions: Conditions) -> SmallMotion | None:
        how_far = self.course(conditions.time_s)[:, None]
        turn = how_far * np.array(self.turn_arcsec) * ARC_SECOND
        return SmallMotion(turn, how_far * 1e-3 * np.array(self.shift_um))

"""Imperfections that are in no catalogue of causes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.effects.effect import Conditions, Effect, Posture, SmallMotion
from armd.simulator.truth.rotations import ARC_SECOND


@dataclass(frozen=True)
class CablePull(Effect):
    """A cable bundle led over two joints twists the first by the product of both angles."""

    joint: int
    other_joint: int
    arcsec_per_rad2: float

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        pull: F64 = phi[:, joint - 1] * phi[:, self.other_joint - 1]
        return self.arcsec_per_rad2 * ARC_SECOND * pull


@dataclass(frozen=True)
class CoupledHysteresis(Effect):
    """Friction winds a joint up by an amount that depends on the angle of another one."""

    joint: int
    other_joint: int
    arcsec: float

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        if joint != self.joint:
            return None
        side = np.tanh(conditions.rate[:, joint - 1] / 2e-5)
        return SmallMotion.about_own_axis(
            -self.arcsec * ARC_SECOND * side * np.sin(posture.phi[:, self.other_joint - 1])
        )


@dataclass(frozen=True)
class DrivenByRate(Effect):
    """Viscous drag deflects a joint by the square of its rate."""

    joint: int
    arcsec_per_rate2: float

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        if joint != self.joint:
            return None
        rate = conditions.rate[:, joint - 1]
        return SmallMotion.about_own_axis(self.arcsec_per_rate2 * ARC_SECOND * rate * np.abs(rate))


@dataclass(frozen=True)
class LettingGo(Effect):
    """Static friction winds a joint up; it decreases with the rate."""

    joint: int
    arcsec: float
    rate_rad_s: float = 0.1

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        if joint != self.joint:
            return None
        rate = conditions.rate[:, joint - 1]
        held_share = np.tanh(rate / 2e-5) * np.exp(-np.abs(rate) / self.rate_rad_s)
        return SmallMotion.about_own_axis(-self.arcsec * ARC_SECOND * held_share)


@dataclass(frozen=True)
class CreepingPlay(Effect):
    """Play that becomes wider by wear from the first reading on."""

    joint: int
    arcsec_per_h: float
    since_s: float  # since the arm was mounted

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        if joint != self.joint:
            return None
        hours = np.maximum(conditions.time_s - self.since_s, 0.0) / 3600.0
        side = np.tanh(conditions.rate[:, joint - 1] / 2e-5)
        return SmallMotion.about_own_axis(-self.arcsec_per_h * ARC_SECOND * hours * side)


@dataclass(frozen=True)
class Bristles(Effect):
    """Friction with memory (Dahl): a joint is wound up towards the side from which it comes.

    The winding changes within an angle of its own. The last stretch before a reading is the turn in
    one second.
    """

    joint: int
    arcsec: float
    within_rad: float

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        if joint != self.joint:
            return None

        def stretched(state: F64, way_rad: float) -> F64:
            remaining_share = np.exp(-abs(way_rad) / self.within_rad)
            return np.asarray(np.sign(way_rad) + (state - np.sign(way_rad)) * remaining_share)

        wound = _wound(joint, posture, conditions, np.zeros(1), stretched)
        return SmallMotion.about_own_axis(-self.arcsec * ARC_SECOND * wound)


@dataclass(frozen=True)
class WideHysteresis(Effect):
    """A joint that follows its drive through springs which slip one after the other (Iwan).

    The way since the last reversal winds it up less and less, to a limit.
    """

    joint: int
    arcsec: float  # when it slips
    within_rad: float

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        if joint != self.joint:
            return None
        slips_rad = self.within_rad * np.array([0.5, 0.75, 1.0, 1.25, 1.5])

        def stretched(state: F64, way_rad: float) -> F64:
            return np.clip(state + way_rad / slips_rad, -1.0, 1.0)

        wound = _wound(joint, posture, conditions, np.zeros(len(slips_rad)), stretched)
        return SmallMotion.about_own_axis(-self.arcsec * ARC_SECOND * wound)


def _wound(
    joint: int,
    posture: Posture,
    conditions: Conditions,
    state: F64,
    stretched: Callable[[F64, float], F64],
) -> F64:
    """Return the mean winding of springs (s,) at each reading (n,).

    It follows the way from the reading before; the last stretch is the turn in one second.
    """
    phi, rate = posture.phi[:, joint - 1], conditions.rate[:, joint - 1]
    wound = np.zeros(len(phi))
    for i in range(len(phi)):
        way_rad = phi[i] - phi[i - 1] - rate[i] if i else 0.0
        state = stretched(stretched(state, way_rad), rate[i])
        wound[i] = state.mean()
    return wound


@dataclass(frozen=True)
class TwoWheels(Effect):
    """A gear between two joints: the error has whole numbers of waves a turn of both."""

    joint: int
    other_joint: int
    waves: int
    other_waves: int
    arcsec: float
    phase: float

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        rolled = self.waves * phi[:, joint - 1] + self.other_waves * phi[:, self.other_joint - 1]
        return self.arcsec * ARC_SECOND * np.asarray(np.sin(rolled + self.phase))

"""Imperfections that no catalogue of causes has."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.simulator.truth.conditions import Conditions
from armd.simulator.truth.effects.base import F64, Effect
from armd.simulator.truth.effects.eccentric_disc import GRATING_RADIUS_MM
from armd.simulator.truth.nominal import REFERENCE_C
from armd.simulator.truth.posture import Posture
from armd.simulator.truth.rotations import ARC_SECOND, Motion


@dataclass(frozen=True)
class CablePull(Effect):
    """A cable bundle led over two joints twists the first by the product of both angles."""

    joint: int
    other: int
    arcsec_per_rad2: float

    def shown(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        pull: F64 = phi[:, joint - 1] * phi[:, self.other - 1]
        return self.arcsec_per_rad2 * ARC_SECOND * pull


@dataclass(frozen=True)
class CoupledHysteresis(Effect):
    """Friction winds a joint up; how far depends on where another one stands."""

    joint: int
    other: int
    arcsec: float

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> Motion | None:
        if joint != self.joint:
            return None
        side = np.tanh(conditions.rate[:, joint - 1] / 2e-5)
        turn = np.zeros((len(posture.phi), 3))
        turn[:, 2] = -self.arcsec * ARC_SECOND * side * np.sin(posture.phi[:, self.other - 1])
        return Motion(turn, np.zeros_like(turn))


@dataclass(frozen=True)
class ThermalEccentricity(Effect):
    """A disc's glue creeps with temperature: its eccentricity grows with every kelvin."""

    joint: int
    um_per_k: float
    direction: float  # rad

    def shown(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        if joint != self.joint:
            return None
        offset_mm = 1e-3 * self.um_per_k * (conditions.link_c[:, joint - 1] - REFERENCE_C)
        turned = phi[:, joint - 1] + self.direction
        bearing: F64 = np.arctan2(
            offset_mm * np.sin(turned), GRATING_RADIUS_MM - offset_mm * np.cos(turned)
        )
        return bearing


@dataclass(frozen=True)
class DrivenByRate(Effect):
    """Viscous drag deflects a joint by the square of its rate."""

    joint: int
    arcsec_per_rate2: float

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> Motion | None:
        if joint != self.joint:
            return None
        rate = conditions.rate[:, joint - 1]
        turn = np.zeros((len(posture.phi), 3))
        turn[:, 2] = self.arcsec_per_rate2 * ARC_SECOND * rate * np.abs(rate)
        return Motion(turn, np.zeros_like(turn))


@dataclass(frozen=True)
class LettingGo(Effect):
    """Static friction winds a joint up; the faster it turns, the less of it is left."""

    joint: int
    arcsec: float
    rate_rad_s: float = 0.1

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> Motion | None:
        if joint != self.joint:
            return None
        rate = conditions.rate[:, joint - 1]
        turn = np.zeros((len(posture.phi), 3))
        held = np.tanh(rate / 2e-5) * np.exp(-np.abs(rate) / self.rate_rad_s)
        turn[:, 2] = -self.arcsec * ARC_SECOND * held
        return Motion(turn, np.zeros_like(turn))

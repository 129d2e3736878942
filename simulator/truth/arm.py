"""The true arm: its own geometry, materials and imperfections.

Nothing here uses armd's model of an arm. Encoders read their optics; links are bodies that expand,
bend and turn in imperfect bearings.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from armd.arrays import F64
from armd.simulator.truth import nominal
from armd.simulator.truth.effects.effect import Conditions, Effect, Masses, Posture, SmallMotion
from armd.simulator.truth.rotations import make_tilt, rotate_about, rotate_about_z


class Movable(Protocol):
    """An arm that a hand can move: takes angles, returns its true tip."""

    @property
    def n_joints(self) -> int: ...

    @property
    def is_rigid(self) -> bool:
        """Whether `posture` already has the true tip."""
        ...

    def encoder_angles(self, phi: F64, conditions: Conditions) -> F64:
        """Return the angles (n, N) rad of ideal encoders for true angles *phi* (n, N) rad."""
        ...

    def tip(self, phi: F64, conditions: Conditions) -> F64:
        """Return the true tip (n, 3) mm, base frame."""
        ...

    def posture(self, phi: F64, conditions: Conditions) -> Posture:
        """Return the frames with which the tip moves, accurate to a thousandth."""
        ...

    def as_rigid(self) -> Movable:
        """Return a faster arm that reaches about the same places."""
        ...


@dataclass(frozen=True)
class Materials:
    """Linear expansion of each link's two lengths and of the stylus, 1/K.

    `growth` is its change with temperature for the links, 1/K².
    """

    along_d: F64  # (N,)
    along_a: F64  # (N,)
    tip: float
    growth: F64  # (N,) 1/K²: strain = along·ΔT + growth·ΔT²

    @classmethod
    def for_demo_arm(cls, joints: int = 6) -> Materials:
        """Make aluminium housings (23 ppm/K) and carbon tubes (about 0.5 ppm/K) between them.

        A link's value is the mean over its sections: the upper arm is 130 mm of housing and 390 mm
        of tube, the forearm 130 mm and 330 mm. The stylus is steel and carbide.
        """
        aluminium, carbon = 23e-6, 0.5e-6
        upper_arm = (130 * aluminium + 390 * carbon) / 520
        forearm = (130 * aluminium + 330 * carbon) / 460
        parts = nominal.list_parts(joints)
        return cls(
            along_d=np.array([aluminium, aluminium, 0.0, forearm, 0.0, 18e-6])[parts],
            along_a=np.array([0.0, upper_arm, aluminium, 0.0, 0.0, 0.0])[parts],
            tip=9e-6,
            growth=np.zeros(joints),
        )

    @classmethod
    def without_expansion(cls, joints: int = 6) -> Materials:
        """Make materials without thermal expansion."""
        return cls(np.zeros(joints), np.zeros(joints), 0.0, np.zeros(joints))


@dataclass(frozen=True)
class TrueArm:
    """An arm with true geometry at the reference temperature, materials, masses and effects."""

    rows: F64  # (N, 5) θ0, d, a, α, β in rad and mm
    tip_offset: F64  # (3,) mm
    materials: Materials
    masses: Masses
    effects: tuple[Effect, ...] = ()
    reference_c: float = nominal.REFERENCE_C

    @classmethod
    def default(cls, seed: int = 1, deviation: float = 1.0, joints: int = 6) -> TrueArm:
        """Make the demo arm "SIM-0001" of this *seed*: off its drawing by about 0.3 mm and 0.05°.

        *deviation* scales that; 0 is an arm made exactly to its drawing. *joints*: 3 to 9.
        """
        rng = np.random.default_rng([seed, 0xA12])
        rows = nominal.list_nominal_rows(joints)
        n = len(rows)
        rows[:, 1:3] += deviation * rng.normal(0.0, 0.3, (n, 2))
        rows[:, [0, 3]] += deviation * np.radians(rng.normal(0.0, 0.05, (n, 2)))
        rows[1, 4] += deviation * np.radians(rng.normal(0.0, 0.05))
        tip = np.array(nominal.TIP_MM) + deviation * rng.normal(0.0, 0.3, 3)
        masses = Masses(
            kg=np.array([joint.mass_kg for joint in nominal.list_nominal_joints(joints)]),
            centre_mm=np.array(
                [joint.centre_of_mass_mm for joint in nominal.list_nominal_joints(joints)]
            ),
        )
        return cls(rows, tip, Materials.for_demo_arm(joints), masses)

    @property
    def n_joints(self) -> int:
        return len(self.rows)

    @property
    def is_rigid(self) -> bool:
        return not self.effects

    def as_rigid(self) -> TrueArm:
        """Return this arm without its imperfections."""
        return self.with_effects()

    def with_effects(self, *effects: Effect) -> TrueArm:
        """Return this arm with these imperfections and no others."""
        return replace(self, effects=effects)

    def with_payload(self, payload_kg: float) -> TrueArm:
        """Return this arm with a weight at its tip."""
        return replace(self, masses=replace(self.masses, payload_kg=payload_kg))

    def encoder_angles(self, phi: F64, conditions: Conditions) -> F64:
        """Return the angles (n, N) rad of encoders of ideal resolution.

        *phi* (n, N) are the true axis angles.
        """
        angles = phi.copy()
        for joint in range(1, self.n_joints + 1):
            for effect in self.effects:
                error = effect.encoder_error_rad(joint, phi, conditions)
                if error is not None:
                    angles[:, joint - 1] += error
        return angles

    def tip(self, phi: F64, conditions: Conditions) -> F64:
        """Return the true tip (n, 3), mm in the base frame, for true axis angles *phi* (n, N)."""
        rigid = self.posture(phi, conditions)
        if not self.effects:
            return rigid.tip
        position, rotation = _start(len(phi))
        for effect in self.effects:
            position, rotation = _move(position, rotation, effect.base(conditions))
        for joint in range(1, self.n_joints + 1):
            for effect in self.effects:
                motion = effect.axis(joint, rigid, conditions)
                position, rotation = _move(position, rotation, motion)
            rotation = rotate_about_z(rotation, phi[:, joint - 1] + self.rows[joint - 1, 0])
            position = position + _apply(rotation, self._link_vector(joint, conditions))
            for effect in self.effects:
                motion = effect.link(joint, rigid, conditions)
                position, rotation = _move(position, rotation, motion)
            rotation = rotation @ make_tilt(self.rows[joint - 1, 3], self.rows[joint - 1, 4])
        position = position + _apply(rotation, self._tip_vector(conditions))
        for effect in self.effects:
            displacement = effect.tip(rigid, conditions)
            if displacement is not None:
                position = position + displacement
        return position

    def posture(self, phi: F64, conditions: Conditions) -> Posture:
        """Return the frames of the arm without any effect except its links' expansion."""
        position, rotation = _start(len(phi))
        origins, rotations, turning = [position], [rotation], []
        for joint in range(1, self.n_joints + 1):
            rotation = rotate_about_z(rotation, phi[:, joint - 1] + self.rows[joint - 1, 0])
            turning.append(rotation)
            position = position + _apply(rotation, self._link_vector(joint, conditions))
            rotation = rotation @ make_tilt(self.rows[joint - 1, 3], self.rows[joint - 1, 4])
            origins.append(position)
            rotations.append(rotation)
        tip = position + _apply(rotation, self._tip_vector(conditions))
        return Posture(
            phi, np.array(origins), np.array(rotations), np.array(turning), tip, self.masses
        )

    def _link_vector(self, link: int, conditions: Conditions) -> F64:
        """Return the vector (n, 3) mm from joint to link end, in the frame that turns with it."""
        delta = conditions.link_c[:, link - 1] - self.reference_c
        extra = self.materials.growth[link - 1] * delta**2
        for effect in self.effects:
            strain = effect.strain(link, conditions)
            if strain is not None:
                extra = extra + strain
        vector = np.zeros((len(delta), 3))
        vector[:, 0] = self.rows[link - 1, 2] * (
            1 + self.materials.along_a[link - 1] * delta + extra
        )
        vector[:, 2] = self.rows[link - 1, 1] * (
            1 + self.materials.along_d[link - 1] * delta + extra
        )
        return vector

    def _tip_vector(self, conditions: Conditions) -> F64:
        delta = conditions.link_c[:, -1:] - self.reference_c
        return self.tip_offset * (1 + self.materials.tip * delta)


def _start(n: int) -> tuple[F64, F64]:
    return np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3))


def _apply(rotation: F64, vector: F64) -> F64:
    """Multiply rotation (n, 3, 3) by vector (n, 3)."""
    turned: F64 = (rotation @ vector[:, :, None])[:, :, 0]
    return turned


def _move(position: F64, rotation: F64, motion: SmallMotion | None) -> tuple[F64, F64]:
    """Shift by, then turn about, the motion's vectors in the present frame."""
    if motion is None:
        return position, rotation
    return position + _apply(rotation, motion.shift_mm), rotation @ rotate_about(motion.turn_rad)

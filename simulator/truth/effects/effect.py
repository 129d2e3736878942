"""The base of physical imperfections, and the data on which they act.

The data are the links' positions, their weights, and the conditions of each reading. Every hook of
the base class leaves the arm unchanged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armd.arrays import F64

GRAVITY = 9.81  # m/s²


@dataclass(frozen=True)
class Masses:
    """The weights of the links and their centres, and a payload at the tip."""

    kg: F64  # (N,)
    centre_mm: F64  # (N, 3) in the link's outgoing frame
    payload_kg: float = 0.0


@dataclass(frozen=True)
class Posture:
    """The rigid arm at n poses: frames in the base frame, mm."""

    phi: F64  # (n, N) true axis angles, rad
    origin: F64  # (N+1, n, 3) of frame k; frame 0 is the base
    rotation: F64  # (N+1, n, 3, 3) of frame k
    joint_rotation: F64  # (N, n, 3, 3) of joint k's turning frame (after Rz, before Rx Ry)
    tip: F64  # (n, 3)
    masses: Masses

    def load(self, link: int) -> tuple[F64, F64]:
        """Return the load at the end of *link*: force (n, 3) N, moment there (n, 3) Nm."""
        return self._weight(link + 1, self.origin[link])

    def torque(self, joint: int) -> F64:
        """Return the gravity torque (n,) Nm about the axis of *joint*, of everything after it."""
        _, moment = self._weight(joint, self.origin[joint - 1])
        axis = self.rotation[joint - 1][:, :, 2]
        torque: F64 = np.einsum("ni,ni->n", moment, axis)
        return torque

    def _weight(self, first: int, about: F64) -> tuple[F64, F64]:
        """Return force and moment about the points *about* of links first…N and the payload."""
        force, moment = np.zeros_like(about), np.zeros_like(about)
        down = np.array([0.0, 0.0, -GRAVITY])
        for link in range(first, len(self.masses.kg) + 1):
            centre = self.origin[link] + self.rotation[link] @ self.masses.centre_mm[link - 1]
            weight = self.masses.kg[link - 1] * down
            force += weight
            moment += np.cross((centre - about) * 1e-3, weight)
        weight = self.masses.payload_kg * down
        return force + weight, moment + np.cross((self.tip - about) * 1e-3, weight)


@dataclass(frozen=True)
class Conditions:
    """The surroundings of n readings."""

    link_c: F64  # (n, N) true mean temperature of each link, °C
    rate: F64  # (n, N) joint rates, rad/s
    time_s: F64  # (n,) seconds since the arm was mounted
    approach: F64  # (n, 3) unit vector of approach, base frame
    ambient_c: F64  # (n,) °C

    @classmethod
    def at_rest(
        cls, n: int, n_joints: int, link_c: float | F64 = 20.0, ambient_c: float = 20.0
    ) -> Conditions:
        """Make n readings at rest at time 0, approached from above.

        *link_c* broadcasts to (n, N).
        """
        return cls(
            link_c=np.broadcast_to(np.asarray(link_c, float), (n, n_joints)).copy(),
            rate=np.zeros((n, n_joints)),
            time_s=np.zeros(n),
            approach=np.tile([0.0, 0.0, -1.0], (n, 1)),
            ambient_c=np.full(n, ambient_c),
        )


class SmallMotion(NamedTuple):
    """A small rigid motion of each row: turn by a rotation vector, then shift, in one frame."""

    turn_rad: F64  # (n, 3)
    shift_mm: F64  # (n, 3)

    @classmethod
    def about_own_axis(cls, angle_rad: F64) -> SmallMotion:
        """Return a turn of a joint by angles (n,) about z, its axis."""
        turn = np.zeros((len(angle_rad), 3))
        turn[:, 2] = angle_rad
        return cls(turn, np.zeros_like(turn))


class Effect:
    """One physical imperfection of the arm.

    A subclass overrides the hooks through which it acts. Joints and links count from 1.
    """

    def encoder_error_rad(self, joint: int, phi: F64, conditions: Conditions) -> F64 | None:
        """Return the error (n,) rad of the encoder of *joint* at true angles phi (n, N)."""
        return None

    def base(self, conditions: Conditions) -> SmallMotion | None:
        """Return the motion of the mount, in the base frame."""
        return None

    def axis(self, joint: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        """Return the motion of the axis of *joint*, in its frame before it turns."""
        return None

    def link(self, link: int, posture: Posture, conditions: Conditions) -> SmallMotion | None:
        """Return the deformation at the end of *link*, in the frame that turns with its joint."""
        return None

    def strain(self, link: int, conditions: Conditions) -> F64 | None:
        """Return the relative change (n,) of the lengths of *link*, beyond its linear expansion."""
        return None

    def tip(self, posture: Posture, conditions: Conditions) -> F64 | None:
        """Return the displacement (n, 3) mm of the tip's centre, in the base frame."""
        return None

"""Where the arm's links are and what they weigh on each other: plain statics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64

GRAVITY = 9.81  # m/s²


@dataclass(frozen=True)
class Masses:
    """What each link weighs and where, and a payload held at the tip."""

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
        """Weight carried beyond the end of link *link*: force (n, 3) N, moment there (n, 3) Nm."""
        return self._weight(link + 1, self.origin[link])

    def torque(self, joint: int) -> F64:
        """Gravity torque (n,) Nm about the axis of *joint*, of everything after it."""
        _, moment = self._weight(joint, self.origin[joint - 1])
        axis = self.rotation[joint - 1][:, :, 2]
        torque: F64 = np.einsum("ni,ni->n", moment, axis)
        return torque

    def _weight(self, first: int, about: F64) -> tuple[F64, F64]:
        """Force and moment about the points *about* of links first…N and the payload."""
        force, moment = np.zeros_like(about), np.zeros_like(about)
        down = np.array([0.0, 0.0, -GRAVITY])
        for link in range(first, len(self.masses.kg) + 1):
            centre = self.origin[link] + self.rotation[link] @ self.masses.centre_mm[link - 1]
            weight = self.masses.kg[link - 1] * down
            force += weight
            moment += np.cross((centre - about) * 1e-3, weight)
        weight = self.masses.payload_kg * down
        return force + weight, moment + np.cross((self.tip - about) * 1e-3, weight)

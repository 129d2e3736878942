"""The chain of joints and its weights, as docs/reference/formats.md defines them, in numpy.

A joint is A = Rz(q + θ)·Tz(d)·Tx(a)·Rx(α)·Ry(β); before joint 1 is the displaced base, Trans(x, y,
z)·Rz·Ry·Rx. Lengths in mm, angles in rad, mass in kg.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64

STANDARD_GRAVITY = 9.80665  # m/s²
DEFAULT_KG_PER_M = 1.0


@dataclass(frozen=True)
class Parameters:
    """The parameters of n rows, or one row for all (n = 1)."""

    rows: F64  # (n, N, 5) θ0, d, a, α, β
    tip_mm: F64  # (n, 3)
    base: F64  # (n, 6) x, y, z in mm; turns about x, y, z in rad


@dataclass(frozen=True)
class Frames:
    """The frames of the arm: frame 0 is the displaced base, frame k the outgoing one of joint k."""

    origin: F64  # (N+1, n, 3) mm, base frame
    rotation: F64  # (N+1, n, 3, 3)
    tip: F64  # (n, 3) mm, base frame

    @property
    def jacobian(self) -> F64:
        """The derivatives (n, 3, N) mm/rad of the tip by each joint's angle, axis × lever."""
        levers = self.tip - self.origin[:-1]
        return np.moveaxis(np.cross(self.rotation[:-1, :, :, 2], levers), 0, 2)


@dataclass(frozen=True)
class LinkWeights:
    """The weights of the links, their centres, and the direction of gravity."""

    kg: F64  # (N,)
    centre_mm: F64  # (N, 3) in each link's outgoing frame
    down: F64  # (3,) unit vector, base frame

    def moment(self, frames: Frames, about: F64, first: int) -> F64:
        """Return the moment (n, 3) Nm of gravity, base frame, about points (n, 3).

        It is that of links *first* … N (from 1).
        """
        moment = np.zeros_like(about)
        for link in range(first, len(self.kg) + 1):
            centre = frames.origin[link] + frames.rotation[link] @ self.centre_mm[link - 1]
            force = self.kg[link - 1] * STANDARD_GRAVITY * self.down
            moment += np.cross((centre - about) / 1000.0, force)
        return moment


def make_rotation(axis: int, angle: F64) -> F64:
    """Make rotations (…, 3, 3) by *angle* (…) about x, y or z (0, 1, 2)."""
    j, k = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.zeros((*np.shape(angle), 3, 3))
    rotation[..., axis, axis] = 1.0
    rotation[..., j, j] = rotation[..., k, k] = np.cos(angle)
    rotation[..., k, j] = np.sin(angle)
    rotation[..., j, k] = -rotation[..., k, j]
    return rotation


def compute_frames(q: F64, parameters: Parameters) -> Frames:
    """Compute the frames of the arm at angles *q* (n, N) rad."""
    n, joints = q.shape
    base = parameters.base
    rotation = (
        make_rotation(2, base[:, 5]) @ make_rotation(1, base[:, 4]) @ make_rotation(0, base[:, 3])
    )
    rotation = np.broadcast_to(rotation, (n, 3, 3))
    origin = np.broadcast_to(base[:, :3], (n, 3))
    origins, rotations = [origin], [rotation]
    for k in range(joints):
        theta, d, a, alpha, beta = np.moveaxis(parameters.rows[:, k], -1, 0)
        rotation = rotation @ make_rotation(2, q[:, k] + theta)
        origin = origin + a[:, None] * rotation[:, :, 0] + d[:, None] * rotation[:, :, 2]
        rotation = rotation @ make_rotation(0, alpha) @ make_rotation(1, beta)
        origins.append(origin)
        rotations.append(rotation)
    tip = origin + np.einsum("nij,nj->ni", rotation, np.broadcast_to(parameters.tip_mm, (n, 3)))
    return Frames(np.array(origins), np.array(rotations), tip)


def estimate_weight(row: F64, end_mm: F64) -> tuple[float, F64]:
    """Estimate mass and centre of a link if arm.toml has neither.

    It has 1 kg per metre, and its centre is midway from its joint to *end_mm* (3,), in its outgoing
    frame; *row* (5,) is nominal.
    """
    _, d, a, alpha, beta = (float(x) for x in row)
    start_mm = -(make_rotation(0, np.array(alpha)) @ make_rotation(1, np.array(beta))).T @ [
        a,
        0.0,
        d,
    ]
    length_mm = math.dist(start_mm, end_mm)
    return DEFAULT_KG_PER_M * length_mm / 1000.0, (start_mm + end_mm) / 2.0

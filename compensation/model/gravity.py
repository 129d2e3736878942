"""Gravity on the links: torques about the joints, moments and directions in the link frames.

A link is the body that moves with its joint. Without a mass in arm.toml, a link has 1 kg per metre
between its joint and the next (the last link: to the tip). Without a centre of mass, it is the
middle of the same stretch.
"""

from __future__ import annotations

import math

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_frames

STANDARD_GRAVITY = 9.80665
DEFAULT_KG_PER_M = 1.0


def list_link_masses(arm: Arm) -> tuple[F64, F64]:
    """Return mass (N,) in kg and centre of mass (N, 3) in mm, in each link's outgoing frame."""
    kg, centre_mm = np.empty(arm.n_joints), np.empty((arm.n_joints, 3))
    for k, joint in enumerate(arm.joint):
        # From the link's end back to its joint: −(a, 0, d) seen after Rx(α)·Ry(β).
        ca, sa = math.cos(math.radians(joint.alpha_deg)), math.sin(math.radians(joint.alpha_deg))
        cb, sb = math.cos(math.radians(joint.beta_deg)), math.sin(math.radians(joint.beta_deg))
        x, y, z = joint.a_mm, sa * joint.d_mm, ca * joint.d_mm
        start = -np.array([cb * x - sb * z, y, sb * x + cb * z])
        end = np.array(arm.tip.offset_mm if k == arm.n_joints - 1 else (0.0, 0.0, 0.0))
        default_kg = DEFAULT_KG_PER_M * float(np.linalg.norm(end - start)) / 1000
        kg[k] = default_kg if joint.mass_kg is None else joint.mass_kg
        centre = joint.centre_of_mass_mm
        centre_mm[k] = (start + end) / 2 if centre is None else centre
    return kg, centre_mm


def compute_gravity_torques(q: F64, p: F64, arm: Arm) -> F64:
    """Compute gravity's torque (n, N) in Nm about each joint's axis, positive with the angle."""
    origins, rotations = compute_frames(q, p)
    torques = np.empty(q.shape)
    for k in range(arm.n_joints):
        # Joint k+1 turns about the z axis of the frame before it, and carries link k+1 onwards.
        moment = _moment(origins, rotations, arm, origins[:, k], k)
        torques[:, k] = np.einsum("ni,ni->n", moment, rotations[:, k, :, 2])
    return torques


def compute_gravity_moments(q: F64, p: F64, arm: Arm) -> F64:
    """Compute the moment (n, N, 3) in Nm of all links beyond a link.

    It is about the link's end, in its outgoing frame.
    """
    origins, rotations = compute_frames(q, p)
    moments = np.empty((*q.shape, 3))
    for k in range(1, arm.n_joints + 1):
        moment = _moment(origins, rotations, arm, origins[:, k], k)
        moments[:, k - 1] = np.einsum("ni,nij->nj", moment, rotations[:, k])
    return moments


def compute_gravity_directions(q: F64, p: F64, arm: Arm) -> F64:
    """Compute the unit vector of gravity (n, N, 3) in each link's outgoing frame."""
    rotations = compute_frames(q, p)[1]
    directions: F64 = np.einsum("i,nkij->nkj", np.array(arm.gravity), rotations[:, 1:])
    return directions


def _moment(origins: F64, rotations: F64, arm: Arm, about: F64, first: int) -> F64:
    """Compute the moment (n, 3) in Nm, base frame, of links *first* (from 0) onwards about points
    (n, 3).
    """
    kg, centre_mm = list_link_masses(arm)
    lever_times_kg = np.zeros((len(origins), 3))
    for j in range(first, arm.n_joints):
        centre = origins[:, j + 1] + np.einsum("nij,j->ni", rotations[:, j + 1], centre_mm[j])
        lever_times_kg += kg[j] * (centre - about)
    return np.cross(lever_times_kg, arm.gravity) * (STANDARD_GRAVITY / 1000)

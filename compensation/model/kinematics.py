"""Forward kinematics and its exact derivatives, for many rows at once.

A joint's row is A = Rz(θ+θ0)·Tz(d)·Tx(a)·Rx(α)·Ry(β); before joint 1 comes the base's displacement
Trans(x, y, z)·Rz·Ry·Rx. Lengths in mm, angles in rad, parameters in the order of `parameters`: one
vector (P,) for all rows or one per row (n, P).
"""

from __future__ import annotations

import math

import numpy as np

from armd.arrays import F64
from armd.compensation.model.parameters import ParameterLayout
from armd.compiled.jit import inlined, jit, unlocked


def compute_pose(q: F64, p: F64) -> tuple[F64, F64]:
    """Compute tip position (n, 3) in mm and rotation (n, 3, 3) of the last frame.

    *q* (n, N): angles in rad.
    """
    q, p = _rows(q, p)
    position, rotation = np.empty((len(q), 3)), np.empty((len(q), 3, 3))
    _forward(q, p, position, rotation)
    clear_partial_positions(position)
    return position, rotation


def clear_partial_positions(position_mm: F64) -> None:
    """Set a whole position (n, 3) to NaN where one coordinate is NaN.

    A missing temperature may affect one coordinate alone, as in the length of a vertical link.
    """
    is_missing = np.isnan(position_mm)
    if is_missing.any():  # seldom, and testing all at once is five times as fast
        position_mm[is_missing.any(axis=1)] = np.nan


def compute_frames(q: F64, p: F64) -> tuple[F64, F64]:
    """Compute origins (n, N+1, 3) and rotations (n, N+1, 3, 3) of all frames.

    [:, 0] is the base's. Frame k ≥ 1 is the outgoing link frame of joint k: A_1 ⋯ A_k applied.
    """
    q, p = _rows(q, p)
    n, n_joints = q.shape
    origins = np.empty((n, n_joints + 1, 3))
    rotations = np.empty((n, n_joints + 1, 3, 3))
    _frames(q, p, origins, rotations)
    return origins, rotations


def compute_jacobian(q: F64, p: F64) -> tuple[F64, F64]:
    """Compute tip position (n, 3) mm and its analytic derivatives (n, 3, P) by every parameter."""
    q, p = _rows(q, p)
    position = np.empty((len(q), 3))
    derivatives = np.empty((len(q), 3, p.shape[1]))
    fill_jacobian(q, p, position, derivatives)
    return position, derivatives


def compute_joint_jacobian(q: F64, p: F64) -> F64:
    """Compute the derivatives (n, 3, N) of the tip position by the joint angles, mm/rad."""
    angles = ParameterLayout(q.shape[1]).angles
    return np.ascontiguousarray(compute_jacobian(q, p)[1][:, :, angles])


def compute_motion_directions(q: F64, rate: F64, p: F64) -> F64:
    """Compute unit vectors (n, 3) of the tip's motion at joint rates (n, N); NaN at rest."""
    velocity = np.einsum("nij,nj->ni", compute_joint_jacobian(q, p), rate)
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    unit: F64 = np.divide(velocity, speed, out=np.full_like(velocity, np.nan), where=speed > 0)
    return unit


def _rows(q: F64, p: F64) -> tuple[F64, F64]:
    """Return C-ordered two-dimensional arrays, so that one compiled signature suffices."""
    q = np.ascontiguousarray(q, dtype=np.float64)
    p = np.atleast_2d(np.ascontiguousarray(p, dtype=np.float64))
    n, n_joints = q.shape
    if p.shape[1] != ParameterLayout(n_joints).count or len(p) not in (1, n):
        raise ValueError(f"parameters {p.shape} do not fit angles {q.shape}")
    return q, p


@jit
def _base(p: F64, origin: F64, rotation: F64) -> None:
    """Fill the base frame from the last six parameters *p*."""
    cx, sx = math.cos(p[3]), math.sin(p[3])
    cy, sy = math.cos(p[4]), math.sin(p[4])
    cz, sz = math.cos(p[5]), math.sin(p[5])
    for axis in range(3):
        origin[axis] = p[axis]
    rotation[0, 0], rotation[0, 1] = cz * cy, cz * sy * sx - sz * cx
    rotation[1, 0], rotation[1, 1] = sz * cy, sz * sy * sx + cz * cx
    rotation[2, 0], rotation[2, 1] = -sy, cy * sx
    rotation[0, 2] = cz * sy * cx + sz * sx
    rotation[1, 2] = sz * sy * cx - cz * sx
    rotation[2, 2] = cy * cx


@inlined
def _turn_on(
    ct: float, st: float, ca: float, sa: float, cb: float, sb: float,
    row: F64, origin: F64, rotation: F64, origin_to: F64, rotation_to: F64,
) -> None:  # fmt: skip
    """Compute a joint's outgoing frame from the frame before it.

    *ct* … *sb* are the cosines and sines of θ, α and β.
    """
    for i in range(3):
        x, y, z = rotation[i, 0], rotation[i, 1], rotation[i, 2]
        x, y = ct * x + st * y, ct * y - st * x  # Rz
        origin_to[i] = origin[i] + row[1] * z + row[2] * x
        y, z = ca * y + sa * z, ca * z - sa * y  # Rx
        rotation_to[i, 0] = cb * x - sb * z  # Ry
        rotation_to[i, 1] = y
        rotation_to[i, 2] = sb * x + cb * z


@jit
def compute_twists(row: F64, twisted: F64) -> None:
    """Fill *twisted* (N, 6) with cosines and sines of α and β, where these changed.

    Most of the time went into sines, and from row to row usually only lengths change.
    """
    for k in range(len(twisted)):
        alpha, beta = row[5 * k + 3], row[5 * k + 4]
        if alpha != twisted[k, 4] or beta != twisted[k, 5]:
            twisted[k, 0], twisted[k, 1] = math.cos(alpha), math.sin(alpha)
            twisted[k, 2], twisted[k, 3] = math.cos(beta), math.sin(beta)
            twisted[k, 4], twisted[k, 5] = alpha, beta


@jit
def _chain(q: F64, row: F64, twisted: F64, origins: F64, rotations: F64) -> None:
    """Compute the frames of one reading."""
    n_joints = len(q)
    _base(row[5 * n_joints + 3 :], origins[0], rotations[0])
    for k in range(n_joints):
        theta = q[k] + row[5 * k]
        _turn_on(
            math.cos(theta), math.sin(theta),
            twisted[k, 0], twisted[k, 1], twisted[k, 2], twisted[k, 3],
            row[5 * k : 5 * k + 5],
            origins[k], rotations[k], origins[k + 1], rotations[k + 1],
        )  # fmt: skip


@jit
def _tip_of(row: F64, origin: F64, rotation: F64, tip: F64) -> None:
    """Compute the *tip* (3,) in the last frame of one reading."""
    for axis in range(3):
        tip[axis] = origin[axis]
        for j in range(3):
            tip[axis] += rotation[axis, j] * row[len(row) - 9 + j]


@unlocked
def _frames(q: F64, p: F64, origins: F64, rotations: F64) -> None:
    twisted = np.full((q.shape[1], 6), np.nan)
    for i in range(len(q)):
        row = p[i if len(p) > 1 else 0]
        compute_twists(row, twisted)
        _chain(q[i], row, twisted, origins[i], rotations[i])


@unlocked
def _forward(q: F64, p: F64, position: F64, rotation: F64) -> None:
    n, n_joints = q.shape
    origins, rotations = np.empty((n_joints + 1, 3)), np.empty((n_joints + 1, 3, 3))
    twisted = np.full((n_joints, 6), np.nan)
    for i in range(n):
        row = p[i if len(p) > 1 else 0]
        compute_twists(row, twisted)
        _chain(q[i], row, twisted, origins, rotations)
        _tip_of(row, origins[n_joints], rotations[n_joints], position[i])
        for row_axis in range(3):
            for axis in range(3):
                rotation[i, row_axis, axis] = rotations[n_joints, row_axis, axis]


@jit
def _turn(axis_x: float, axis_y: float, axis_z: float, arm: F64, out: F64) -> None:
    """Compute out = axis × arm: the tip's motion when everything behind it turns about the axis."""
    out[0] = axis_y * arm[2] - axis_z * arm[1]
    out[1] = axis_z * arm[0] - axis_x * arm[2]
    out[2] = axis_x * arm[1] - axis_y * arm[0]


@jit
def place_tip(
    q: F64, row: F64, twisted: F64, origins: F64, rotations: F64, tip: F64, levers: F64
) -> None:
    """Compute the *tip* (3,) of one reading and its *levers* (3, N), mm/rad.

    The levers are the derivatives of `fill_jacobian` by the angles alone. *twisted* is of *row*;
    *origins* and *rotations* are buffers for frames.
    """
    n_joints = len(q)
    _chain(q, row, twisted, origins, rotations)
    _tip_of(row, origins[n_joints], rotations[n_joints], tip)
    to_tip = np.empty(3)
    for k in range(n_joints):
        z = rotations[k]
        for axis in range(3):
            to_tip[axis] = tip[axis] - origins[k, axis]
        _turn(z[0, 2], z[1, 2], z[2, 2], to_tip, levers[:, k])


@unlocked
def fill_jacobian(q: F64, p: F64, position: F64, derivatives: F64) -> None:
    n, n_joints = q.shape
    origins = np.empty((n_joints + 1, 3))
    rotations = np.empty((n_joints + 1, 3, 3))
    # Loops over the three axes instead of slices, which would allocate and compile for seconds.
    to_tip, beyond, y = np.empty(3), np.empty(3), np.empty(3)
    tip, base = 5 * n_joints, 5 * n_joints + 3
    turned, twisted = np.empty((n_joints, 2)), np.full((n_joints, 6), np.nan)
    for i in range(n):
        row = p[i if len(p) > 1 else 0]
        if i == 0 or len(p) > 1:
            _base(row[base:], origins[0], rotations[0])
            compute_twists(row, twisted)
        for k in range(n_joints):
            theta = q[i, k] + row[5 * k]
            turned[k, 0], turned[k, 1] = math.cos(theta), math.sin(theta)
            _turn_on(
                turned[k, 0], turned[k, 1],
                twisted[k, 0], twisted[k, 1], twisted[k, 2], twisted[k, 3],
                row[5 * k : 5 * k + 5],
                origins[k], rotations[k], origins[k + 1], rotations[k + 1],
            )  # fmt: skip
        last = rotations[n_joints]
        for axis in range(3):
            position[i, axis] = origins[n_joints, axis]
            for j in range(3):
                position[i, axis] += last[axis, j] * row[tip + j]
                derivatives[i, axis, tip + j] = last[axis, j]
                derivatives[i, axis, base + j] = 1.0 if axis == j else 0.0
        for k in range(n_joints):
            before, block = rotations[k], derivatives[i, :, 5 * k : 5 * k + 5]
            ct, st, ca, sa = turned[k, 0], turned[k, 1], twisted[k, 0], twisted[k, 1]
            for axis in range(3):
                to_tip[axis] = position[i, axis] - origins[k, axis]
                beyond[axis] = position[i, axis] - origins[k + 1, axis]
                across = ct * before[axis, 1] - st * before[axis, 0]
                block[axis, 1] = before[axis, 2]
                block[axis, 2] = ct * before[axis, 0] + st * before[axis, 1]
                y[axis] = ca * across + sa * before[axis, 2]
            _turn(before[0, 2], before[1, 2], before[2, 2], to_tip, block[:, 0])
            _turn(block[0, 2], block[1, 2], block[2, 2], beyond, block[:, 3])
            _turn(y[0], y[1], y[2], beyond, block[:, 4])
        for axis in range(3):
            beyond[axis] = position[i, axis] - row[base + axis]
        cz, sz = math.cos(row[base + 5]), math.sin(row[base + 5])
        x = rotations[0, :, 0]
        _turn(x[0], x[1], x[2], beyond, derivatives[i, :, base + 3])
        _turn(-sz, cz, 0.0, beyond, derivatives[i, :, base + 4])
        _turn(0.0, 0.0, 1.0, beyond, derivatives[i, :, base + 5])

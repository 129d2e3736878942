"""Compiled algebra of a small matrix in each row, because numpy calls LAPACK row by row.

For a turn of three axes or a covariance of three by three, such a call takes ten times as long as
the computation.
"""

from __future__ import annotations

import math

import numpy as np

from armd.arrays import F64
from armd.compensation.model.kinematics import compute_twists, place_tip
from armd.compiled.jit import jit, unlocked


def rotate_towards(
    q: F64, p: F64, there_mm: F64, turns: int, least_lever: float, most_turn_rad: float
) -> F64:
    """Return angles (n, N) near *q* that put the tip at *there_mm* (n, 3).

    *turns* Newton steps are made, with parameters *p* (n, P). A direction whose lever is shorter
    than the share *least_lever* of the reading's longest is hardly turned towards; no reading is
    turned by more than *most_turn_rad*.
    """
    q, p, there_mm = (np.ascontiguousarray(rows, dtype=np.float64) for rows in (q, p, there_mm))
    if not len(q) == len(p) == len(there_mm):
        raise ValueError(f"rows: found {len(q)}, {len(p)} and {len(there_mm)}, expected the same")
    turned = np.empty_like(q)
    fill_turned(q, p, there_mm, turns, least_lever**2, most_turn_rad, turned)
    return turned


def compute_least_turns(levers: F64, least_lever: float) -> F64:
    """Compute the smallest turn (n, N, 3), rad/mm, that moves the tip along each axis.

    *levers* (n, 3, N) are in mm/rad; *least_lever* as in `rotate_towards`.
    """
    n, _, n_joints = levers.shape
    turns = np.empty((n, n_joints, 3))
    fill_least_turns(np.ascontiguousarray(levers), least_lever**2, turns)
    return turns


def compute_whitening(covariance: F64, weight: F64) -> F64:
    """Compute W (n, 3, 3), lower, with WᵀW = weight (n,) · the inverse of *covariance* (n, 3, 3).

    Raises `LinAlgError` for one that is not positive definite.
    """
    whiten, root = np.zeros(covariance.shape), np.ascontiguousarray(np.sqrt(weight))
    if not fill_whitening(np.ascontiguousarray(covariance), root, whiten):
        raise np.linalg.LinAlgError("the covariance of a reading is not positive definite")
    return whiten


def compute_stretched_covariance(
    levers: F64, before: F64, backwards: F64, encoder_variance: float, own_variance: F64
) -> F64:
    """Compute the covariance (n, 3, 3) of encoders and of a reading's own noise.

    The encoders act at *levers* (n, 3, N). The noise has *own_variance* (n,) at levers *before* (n,
    3, N), and *backwards* (n, N, 3) is the inverse of these.
    """
    covariance = np.empty((len(levers), 3, 3))
    levers, before, backwards = map(np.ascontiguousarray, (levers, before, backwards))
    fill_stretch(levers, before, backwards, float(encoder_variance), own_variance, covariance)
    return covariance


@unlocked
def fill_turned(
    q: F64,
    p: F64,
    there_mm: F64,
    turns: int,
    least_square: float,
    most_turn_rad: float,
    turned: F64,
) -> None:
    n, n_joints = q.shape
    origins, rotations = np.empty((n_joints + 1, 3)), np.empty((n_joints + 1, 3, 3))
    tip, levers, towards = np.empty(3), np.empty((3, n_joints)), np.empty(3)
    twisted = np.full((n_joints, 6), np.nan)
    for i in range(n):
        compute_twists(p[i], twisted)
        angles = turned[i]
        for k in range(n_joints):
            angles[k] = q[i, k]
        for _ in range(turns):
            place_tip(angles, p[i], twisted, origins, rotations, tip, levers)
            for axis in range(3):
                towards[axis] = there_mm[i, axis] - tip[axis]
            _solve(levers, least_square, towards)
            square = 0.0
            for k in range(n_joints):
                turn = angles[k] - q[i, k]
                for axis in range(3):
                    turn += levers[axis, k] * towards[axis]
                angles[k] = turn
                square += turn * turn
            size = math.sqrt(square)
            share = most_turn_rad / size if size > most_turn_rad else 1.0
            for k in range(n_joints):
                angles[k] = q[i, k] + share * angles[k]


@unlocked
def fill_least_turns(levers: F64, least_square: float, turns: F64) -> None:
    side = np.empty(3)
    for i in range(len(levers)):
        for column in range(3):
            for axis in range(3):
                side[axis] = 1.0 if axis == column else 0.0
            _solve(levers[i], least_square, side)
            for k in range(levers.shape[2]):
                turn = 0.0
                for axis in range(3):
                    turn += levers[i, axis, k] * side[axis]
                turns[i, k, column] = turn


@jit
def _solve(levers: F64, least_square: float, side: F64) -> None:
    """Solve (J Jᵀ + *least_square* · trace) x = *side* (3,) in place; J is *levers* (3, N)."""
    xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(levers.shape[1]):
        x, y, z = levers[0, k], levers[1, k], levers[2, k]
        xx, yy, zz = xx + x * x, yy + y * y, zz + z * z
        xy, xz, yz = xy + x * y, xz + x * z, yz + y * z
    damping = least_square * (xx + yy + zz)
    a, ba, ca, b, cb, c = _cholesky(xx + damping, xy, xz, yy + damping, yz, zz + damping)
    x = side[0] / a
    y = (side[1] - ba * x) / b
    z = (side[2] - ca * x - cb * y) / c
    side[2] = z / c
    side[1] = (y - cb * side[2]) / b
    side[0] = (x - ba * side[1] - ca * side[2]) / a


@jit
def _cholesky(
    xx: float, xy: float, xz: float, yy: float, yz: float, zz: float
) -> tuple[float, float, float, float, float, float]:
    """Return the lower factor ((a, 0, 0), (ba, b, 0), (ca, cb, c)), column by column."""
    a = math.sqrt(xx)
    ba, ca = xy / a, xz / a
    b = math.sqrt(yy - ba * ba)
    cb = (yz - ca * ba) / b
    return a, ba, ca, b, cb, math.sqrt(zz - ca * ca - cb * cb)


@unlocked
def fill_whitening(covariance: F64, root_weight: F64, whiten: F64) -> bool:
    """Fill the lower part of *whiten*; return whether all are positive definite."""
    definite = True
    for i in range(len(covariance)):
        matrix, to, root = covariance[i], whiten[i], root_weight[i]
        a, ba, ca, b, cb, c = _cholesky(
            matrix[0, 0], matrix[1, 0], matrix[2, 0], matrix[1, 1], matrix[2, 1], matrix[2, 2]
        )
        to[0, 0], to[1, 1], to[2, 2] = root / a, root / b, root / c
        to[1, 0], to[2, 1] = -ba * to[0, 0] / b, -cb * to[1, 1] / c
        to[2, 0] = -(ca * to[0, 0] + cb * to[1, 0]) / c
        definite = definite and a > 0.0 and b > 0.0 and c > 0.0
    return definite


@unlocked
def fill_stretch(
    levers: F64,
    before: F64,
    backwards: F64,
    encoder_variance: float,
    own_variance: F64,
    covariance: F64,
) -> None:
    stretch = np.empty((3, 3))
    for i in range(len(levers)):
        for row in range(3):
            for column in range(3):
                value = 1.0 if row == column else 0.0
                for k in range(levers.shape[2]):
                    value += (levers[i, row, k] - before[i, row, k]) * backwards[i, k, column]
                stretch[row, column] = value
        for row in range(3):
            for column in range(row + 1):
                of_encoders, stretched = 0.0, 0.0
                for k in range(levers.shape[2]):
                    of_encoders += levers[i, row, k] * levers[i, column, k]
                for k in range(3):
                    stretched += stretch[row, k] * stretch[column, k]
                value = encoder_variance * of_encoders + own_variance[i] * stretched
                covariance[i, row, column] = value
                covariance[i, column, row] = value

"""Compute corrected points of samples, with orientation and covariance."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from armd.arrays import F64, I64
from armd.compensation.kernel.chain import compute_quaternion
from armd.compensation.kernel.kernel import take_angles, to_world, to_world_posed
from armd.compensation.kernel.memory import FlatModel, Folded, Program, Work, open_flat
from armd.compensation.model.kinematics import fill_jacobian
from armd.compiled.jit import inlined, jit

#: Columns of the factor that are processed together. A constant, so that LLVM can prove that the
#: sums along x, y and z do not overlap.
COLUMNS = 128


@jit
def fill(
    q: F64, rate: F64, approach: F64, flat: FlatModel, factor: F64, rows: I64, floor: float,
    points: npt.NDArray[np.void],
) -> None:  # fmt: skip
    """Fill position, orientation, correction and covariance of *points* (n,), dtype `armd.POINT`.

    The covariance is (J·L)(J·L)' + *floor*. L is *factor* (R, r), whose *rows* (R,) are parameters
    and, from P on, pose terms. The covariance is NaN if *floor* is.
    """
    folded, program, work = open_flat(flat)
    angle, trig, vectors = work.angle, work.trig, work.vectors
    tip, plain_tip = folded.parameters[5 * len(angle) :], folded.constants[5 * len(angle) :]
    for start in range(0, len(q), angle.shape[1]):
        m = min(angle.shape[1], len(q) - start)
        take_angles(q, start, m, angle, trig)
        if len(program.parameter):
            to_world_posed(rate, approach, start, m, folded, program, work, 3)
        else:
            to_world(folded.matrices, tip, trig, vectors, 0)
            to_world(folded.matrices, tip, trig, vectors, 3)
        to_world(folded.constant, plain_tip, trig, vectors, 9)
        for i in range(m):
            point = points[start + i]
            for axis in range(3):
                point.position_mm[axis] = vectors[axis, i]
                point.correction_mm[axis] = vectors[axis, i] - vectors[9 + axis, i]
            turn = compute_quaternion(vectors, i)
            for part in range(4):
                point.orientation[part] = turn[part]
        if math.isnan(floor):
            for i in range(m):
                for part in range(6):
                    points[start + i].covariance_mm2[part] = math.nan
        else:
            _covariances(q, start, folded, program, work, factor, rows, floor, points, m)


@jit
def _covariances(
    q: F64, start: int, folded: Folded, program: Program, work: Work, factor: F64, rows: I64,
    floor: float, points: npt.NDArray[np.void], m: int,
) -> None:  # fmt: skip
    rank, count = factor.shape[1], len(folded.parameters)
    parameters = folded.parameters.reshape(1, count)
    if len(program.parameter):
        parameters = _with_pose_terms(folded, program, work, m)
    position = np.empty((m, 3))
    derivatives = np.empty((m, 3, count))
    fill_jacobian(q[start : start + m], parameters, position, derivatives)
    # Rows of L are taken four at a time: rows beyond the last have zero derivatives.
    j, along = np.zeros(3 * (len(rows) + 3)), np.empty(3 * COLUMNS)
    for i in range(m):
        for row in range(len(rows)):
            column, weight = find_weight(rows[row], count, program, work, i)
            for axis in range(3):
                j[3 * row + axis] = weight * derivatives[i, axis, column]
        xx, xy, xz, yy, yz, zz = floor, 0.0, 0.0, floor, 0.0, floor
        for first in range(0, rank, COLUMNS):
            width = min(COLUMNS, rank - first)
            for axis in range(3):
                for r in range(width):
                    along[axis * COLUMNS + r] = 0.0
            for row in range(0, len(rows), 4):
                last = len(rows) - 1
                _add_four(
                    j[3 * row :], factor[row, first:], factor[min(row + 1, last), first:],
                    factor[min(row + 2, last), first:], factor[min(row + 3, last), first:],
                    width, along,
                )  # fmt: skip
            for r in range(width):
                x, y, z = along[r], along[COLUMNS + r], along[2 * COLUMNS + r]
                xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
                yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
        covariance = points[start + i].covariance_mm2
        covariance[0], covariance[1], covariance[2] = xx, xy, xz
        covariance[3], covariance[4], covariance[5] = yy, yz, zz


@inlined
def _add_four(j: F64, a: F64, b: F64, c: F64, d: F64, width: int, along: F64) -> None:
    """Add the products of four rows of L and their derivatives *j*, three each, to *along*.

    *along* (3 COLUMNS,) holds x, y, z of J·L.
    """
    ax, ay, az = j[0], j[1], j[2]
    bx, by, bz = j[3], j[4], j[5]
    cx, cy, cz = j[6], j[7], j[8]
    dx, dy, dz = j[9], j[10], j[11]
    for r in range(width):
        p, q, s, t = a[r], b[r], c[r], d[r]
        along[r] += ax * p + bx * q + cx * s + dx * t
        along[COLUMNS + r] += ay * p + by * q + cy * s + dy * t
        along[2 * COLUMNS + r] += az * p + bz * q + cz * s + dz * t


@jit
def _with_pose_terms(folded: Folded, program: Program, work: Work, m: int) -> F64:
    """Return the parameters (m, P) of the block's samples, including the pose terms."""
    count = len(folded.parameters)
    parameters = np.empty((m, count))
    for i in range(m):
        for p in range(count):
            parameters[i, p] = folded.parameters[p]
        for t in range(len(program.parameter)):
            change = folded.coefficients[t] * compute_pose_basis(program, work, t, i)
            parameters[i, program.parameter[t]] += change
    return parameters


@jit
def find_weight(row: int, count: int, program: Program, work: Work, i: int) -> tuple[int, float]:
    """Return the parameter by which unknown *row* moves sample *i* of the block, and its weight.

    A parameter acts by itself; numbers from *count* on are coefficients of pose terms.
    """
    if row < count:
        return row, 1.0
    return program.parameter[row - count], compute_pose_basis(program, work, row - count, i)


@jit
def compute_pose_basis(program: Program, work: Work, t: int, i: int) -> float:
    """Compute the basis value of pose term *t* at sample *i* of the block."""
    value = 1.0
    for j in range(program.factor_first[t], program.factor_first[t + 1]):
        value *= work.factors[program.term_factors[j], i]
    return value

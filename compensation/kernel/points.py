"""Corrected points of samples, with orientation and covariance."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from armd.arrays import F64, I64
from armd.compensation.kernel.chain import quaternion
from armd.compensation.kernel.kernel import take_angles, to_world, to_world_posed
from armd.compensation.kernel.memory import FlatModel, Program, Work, opened
from armd.compensation.model.kinematics import compiled_jacobian
from armd.compiled.jit import jit


@jit
def fill(
    q: F64, rate: F64, approach: F64, flat: FlatModel, factor: F64, rows: I64, floor: float,
    points: npt.NDArray[np.void],
) -> None:  # fmt: skip
    """Position, orientation, correction and covariance of *points* (n,), dtype `armd.POINT`.

    The covariance is (J·L)(J·L)' + *floor*, L being *factor* (R, r), whose rows (R,) are parameters
    and, from P on, pose terms; NaN if *floor* is.
    """
    folded, program, work = opened(flat)
    angle, trig, vectors, count = work.angle, work.trig, work.vectors, len(folded.parameters)
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
            turn = quaternion(vectors, i)
            for part in range(4):
                point.orientation[part] = turn[part]
        if math.isnan(floor):
            for i in range(m):
                for part in range(6):
                    points[start + i].covariance_mm2[part] = math.nan
        else:
            parameters = folded.parameters.reshape(1, count)
            _covariances(q, start, parameters, program, work, factor, rows, floor, points, m)


@jit
def _covariances(
    q: F64, start: int, parameters: F64, program: Program, work: Work, factor: F64, rows: I64,
    floor: float, points: npt.NDArray[np.void], m: int,
) -> None:  # fmt: skip
    rank, count = factor.shape[1], parameters.shape[1]
    position = np.empty((m, 3))
    derivatives = np.empty((m, 3, count))
    compiled_jacobian(q[start : start + m], parameters, position, derivatives)
    moved = np.empty((3, rank))
    for i in range(m):
        moved[:] = 0.0
        for row in range(len(factor)):
            column, weight = moves_by(rows[row], count, program, work, i)
            jx = weight * derivatives[i, 0, column]
            jy = weight * derivatives[i, 1, column]
            jz = weight * derivatives[i, 2, column]
            for r in range(rank):
                moved[0, r] += jx * factor[row, r]
                moved[1, r] += jy * factor[row, r]
                moved[2, r] += jz * factor[row, r]
        part = 0
        for a in range(3):
            for b in range(a, 3):
                total = floor if a == b else 0.0
                for r in range(rank):
                    total += moved[a, r] * moved[b, r]
                points[start + i].covariance_mm2[part] = total
                part += 1


@jit
def moves_by(row: int, count: int, program: Program, work: Work, i: int) -> tuple[int, float]:
    """By which of *count* parameters an unknown moves sample *i* of the block, with what weight:
    itself; numbers from *count* on are coefficients of pose terms."""
    if row < count:
        return row, 1.0
    return program.parameter[row - count], pose_basis(program, work, row - count, i)


@jit
def pose_basis(program: Program, work: Work, t: int, i: int) -> float:
    """What pose term *t* multiplies its coefficient with, at sample *i* of the block."""
    value = 1.0
    for j in range(program.factor_first[t], program.factor_first[t + 1]):
        value *= work.factors[program.term_factors[j], i]
    return value

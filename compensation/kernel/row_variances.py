"""Covariances of many samples, each at its own temperatures and time.

The sum is the live path's (GUM, law of propagation: J Σ J' with Σ of the identified parameters and
coefficients, the encoders and the sensors). Live it is brought to few columns when a temperature
arrives, so that a sample comes cheap; here it is taken whole, and put together once for neighbours
of equal temperatures.
"""

from __future__ import annotations

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.kernel.covariance import Parts, assemble
from armd.compensation.kernel.kernel import alike, take_angles
from armd.compensation.kernel.memory import Amounts, FlatModel, Program, Work, fold, opened
from armd.compensation.kernel.points import moves_by, pose_basis
from armd.compensation.kernel.pose_factors import evaluate_factors
from armd.compensation.kernel.slow_factors import SlowProgram, evaluate
from armd.compensation.model.kinematics import compiled_jacobian
from armd.compiled.jit import jit, unlocked


@unlocked
def row_variances(
    values: F64, celsius: F64, unix_s: F64, more_c: float, slow: SlowProgram, amounts: Amounts,
    q: F64, rate: F64, approach: F64, flat: FlatModel, parts: Parts, rows: I64, floor: float,
    covariance: F64,
) -> None:  # fmt: skip
    """Covariances (n, 6) in mm², xx xy xz yy yz zz, of n samples, at *celsius* (n, S), *unix_s*.

    *values* (n, L+T) are their slow factors'; *more_c* is a sensor's standard deviation; *rows*,
    *parts* and *floor* are of `covariance.Uncertainty`.
    """
    n = len(rows)
    matrix, left = np.empty((n, n)), np.empty(n)
    changes = np.empty((celsius.shape[1] + 2 if more_c else 2, values.shape[1]))
    first = 0
    while first < len(q):
        end = first + 1
        while end < len(q) and (
            unix_s[end] == unix_s[first]
            and alike(values, end, first)
            and alike(celsius, end, first)
        ):
            end += 1
        fold(values[first], amounts, flat)
        if more_c:
            evaluate(celsius[first], unix_s[first], more_c, slow, changes)
        assemble(values[first], changes[2:], parts, matrix, left)
        for i in range(n):
            for j in range(n):
                matrix[i, j] /= parts.scale[i] * parts.scale[j]
        _of_run(q, rate, approach, first, end, flat, matrix, rows, floor, covariance)
        first = end


@jit
def _of_run(
    q: F64, rate: F64, approach: F64, first: int, end: int, flat: FlatModel, matrix: F64, rows: I64,
    floor: float, covariance: F64,
) -> None:  # fmt: skip
    """Samples *first* to *end* with one *matrix* (R, R), the covariance of what *rows* (R,) are."""
    folded, program, work = opened(flat)
    width, count = work.angle.shape[1], len(folded.parameters)
    parameters = np.empty((width, count))
    position, derivatives = np.empty((width, 3)), np.empty((width, 3, count))
    moved = np.empty((len(rows), 3))
    for start in range(first, end, width):
        m = min(width, end - start)
        if len(program.parameter):
            take_angles(q, start, m, work.angle, work.trig)
            evaluate_factors(rate, approach, start, folded.plain, program, work, m)
        for i in range(m):
            for p in range(count):
                parameters[i, p] = folded.parameters[p]
            for t in range(len(program.parameter)):
                more = folded.coefficients[t] * pose_basis(program, work, t, i)
                parameters[i, program.parameter[t]] += more
        compiled_jacobian(q[start : start + m], parameters[:m], position, derivatives)
        for i in range(m):
            _move(derivatives, i, count, program, work, rows, moved)
            x = y = z = floor
            xy = xz = yz = 0.0
            for a in range(len(rows)):
                along_x = along_y = along_z = 0.0
                for b in range(a):
                    along_x += matrix[a, b] * moved[b, 0]
                    along_y += matrix[a, b] * moved[b, 1]
                    along_z += matrix[a, b] * moved[b, 2]
                x += (2 * along_x + matrix[a, a] * moved[a, 0]) * moved[a, 0]
                y += (2 * along_y + matrix[a, a] * moved[a, 1]) * moved[a, 1]
                z += (2 * along_z + matrix[a, a] * moved[a, 2]) * moved[a, 2]
                here_x, here_y = matrix[a, a] * moved[a, 0], matrix[a, a] * moved[a, 1]
                xy += along_x * moved[a, 1] + (along_y + here_y) * moved[a, 0]
                xz += along_z * moved[a, 0] + (along_x + here_x) * moved[a, 2]
                yz += along_z * moved[a, 1] + (along_y + here_y) * moved[a, 2]
            row = covariance[start + i]
            row[0], row[1], row[2], row[3], row[4], row[5] = x, xy, xz, y, yz, z


@jit
def _move(
    derivatives: F64, i: int, count: int, program: Program, work: Work, rows: I64, moved: F64
) -> None:
    """How a unit of each of *rows* (R,) moves sample *i* of the block, into *moved* (R, 3)."""
    for row in range(len(rows)):
        column, weight = moves_by(rows[row], count, program, work, i)
        for axis in range(3):
            moved[row, axis] = weight * derivatives[i, axis, column]

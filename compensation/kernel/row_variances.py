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
from armd.compensation.kernel.memory import Amounts, FlatModel, fold, opened
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
    # Of each row: x of a block's m samples, then y, then z. So every loop runs over samples.
    moved = np.empty((len(rows), 3 * width))
    along = np.empty(3 * width)
    for start in range(first, end, width):
        m = min(width, end - start)
        if len(program.parameter):
            take_angles(q, start, m, work.angle, work.trig)
            evaluate_factors(rate, approach, start, folded.plain, program, work, m)
        is_one = len(program.parameter) == 0  # then one row of parameters serves all samples
        for i in range(1 if is_one else m):
            for p in range(count):
                parameters[i, p] = folded.parameters[p]
            for t in range(len(program.parameter)):
                more = folded.coefficients[t] * pose_basis(program, work, t, i)
                parameters[i, program.parameter[t]] += more
        distinct = parameters[: 1 if is_one else m]
        compiled_jacobian(q[start : start + m], distinct, position, derivatives)
        for row in range(len(rows)):
            for i in range(m):
                column, weight = moves_by(rows[row], count, program, work, i)
                for axis in range(3):
                    moved[row, axis * m + i] = weight * derivatives[i, axis, column]
        block = covariance[start : start + m]
        for i in range(m):
            block[i, 0] = block[i, 3] = block[i, 5] = floor
            block[i, 1] = block[i, 2] = block[i, 4] = 0.0
        for a in range(len(rows)):
            for j in range(3 * m):
                along[j] = 0.0
            for b in range(0, a - 3, 4):
                _add_four(matrix[a, b : b + 4], moved[b : b + 4], 3 * m, along)
            for b in range(a - a % 4, a):
                _add(matrix[a, b], moved[b], 3 * m, along)
            _add_products(matrix[a, a], moved[a], along, block)


@jit
def _add(weight: float, values: F64, n: int, total: F64) -> None:
    """Add *weight* times the first *n* of *values* to *total*."""
    for j in range(n):
        total[j] += weight * values[j]


@jit
def _add_four(weight: F64, values: F64, n: int, total: F64) -> None:
    """Add *weight* (4,) times the first *n* columns of *values* (4, …) to *total*: four at once
    read and write it once."""
    one, two, three, four = weight[0], weight[1], weight[2], weight[3]
    first, second, third, fourth = values[0], values[1], values[2], values[3]
    for j in range(n):
        total[j] = total[j] + one * first[j] + two * second[j] + three * third[j] + four * fourth[j]


@jit
def _add_products(weight: float, moved: F64, along: F64, block: F64) -> None:
    """Add one row's products to a block's covariances (m, 6): with itself by *weight*, with all
    rows before it by *along* (3 m,), the sum of theirs by their weights."""
    m = len(block)
    for i in range(m):
        x, y, z = moved[i], moved[m + i], moved[2 * m + i]
        along_x, along_y, along_z = along[i], along[m + i], along[2 * m + i]
        block[i, 0] += (2 * along_x + weight * x) * x
        block[i, 3] += (2 * along_y + weight * y) * y
        block[i, 5] += (2 * along_z + weight * z) * z
        block[i, 1] += along_x * y + (along_y + weight * y) * x
        block[i, 2] += along_z * x + (along_x + weight * x) * z
        block[i, 4] += along_z * y + (along_y + weight * y) * z

"""Compute covariances of many samples, each at its own temperatures and time.

The sum is that of the live path (GUM, law of propagation): J Σ J' with Σ of the identified
parameters and coefficients, the encoders and the sensors. The live path reduces Σ to few columns
when a temperature arrives, so that a sample is cheap. Here Σ is used whole, and assembled once for
neighbours of equal temperatures.

Derivatives are computed for a block of samples, whatever their temperatures
(`compute_block_jacobian`). The products of a run of equal temperatures take four rows of Σ at a
time.
"""

from __future__ import annotations

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.kernel.block_jacobian import (
    compute_block_jacobian,
    find_row,
    make_work,
    take_parameters,
)
from armd.compensation.kernel.covariance import Parts, assemble
from armd.compensation.kernel.kernel import are_alike, take_angles
from armd.compensation.kernel.memory import BLOCK as W
from armd.compensation.kernel.memory import (
    Amounts,
    FlatModel,
    Folded,
    Program,
    Work,
    fold,
    open_flat,
)
from armd.compensation.kernel.points import compute_pose_basis, find_weight
from armd.compensation.kernel.pose_factors import evaluate_factors
from armd.compensation.kernel.slow_factors import SlowProgram, evaluate
from armd.compiled.jit import jit, unlocked

#: The numbers of a block's samples along three axes, one axis after another.
AXES = 3 * W


@unlocked
def compute_row_variances(
    values: F64, celsius: F64, unix_s: F64, more_c: float, slow: SlowProgram, amounts: Amounts,
    q: F64, rate: F64, approach: F64, flat: FlatModel, parts: Parts, rows: I64, floor: float,
    covariance: F64,
) -> None:  # fmt: skip
    """Compute covariances (n, 6) in mm², xx xy xz yy yz zz, of n samples.

    The samples are at *celsius* (n, S) and *unix_s*. *values* (n, L+T) are their slow factors';
    *more_c* is a sensor's standard deviation; *rows*, *parts* and *floor* are of
    `covariance.Uncertainty`.
    """
    folded, program, work = open_flat(flat)
    n_joints, posed = q.shape[1], len(program.parameter) > 0
    count, n = len(folded.parameters), len(rows)
    matrix, scratch = np.empty((n, n)), np.empty(n)
    changes = np.empty((celsius.shape[1] + 2 if more_c else 2, values.shape[1]))
    # Rows of Σ are taken four at a time, so zero rows follow the last one.
    padded = np.zeros((n + 3 - (n + 3) % 4, n + 3 - (n + 3) % 4))
    along = np.empty(4 * AXES)
    total = np.empty(6 * W)
    # For each sample of a block: whether its temperatures are new; parameters, coefficients.
    begins = np.empty(W, np.bool_)
    parameters, with_pose = np.empty((count, W)), np.empty((count, W))
    coefficients = np.empty((len(program.parameter), W))
    derivatives = make_work(n_joints, 3 + 3 * len(program.parameter))
    places = _places(rows, count, n_joints, len(padded), derivatives)
    flat_derivatives = derivatives.reshape(derivatives.size)
    settled = False  # the samples of the last block had one row of parameters, still valid
    for start in range(0, len(q), W):
        m = min(W, len(q) - start)
        changed = False
        for i in range(m):
            row = start + i
            begins[i] = row == 0 or not (
                unix_s[row] == unix_s[row - 1]
                and are_alike(values, row, row - 1)
                and are_alike(celsius, row, row - 1)
            )
            changed = changed or begins[i]
        if changed or not settled:
            for i in range(m):
                if begins[i]:
                    fold(values[start + i], amounts, flat)
                _take_column(folded, i, parameters, coefficients)
            for i in range(m, W):
                _take_column(folded, i, parameters, coefficients)
        if posed:
            take_angles(q, start, m, work.angle, work.trig)
            evaluate_factors(rate, approach, start, folded.constant, program, work, m)
            _add_pose_terms(parameters, coefficients, program, work, m, with_pose)
            take_parameters(with_pose, n_joints, derivatives)
            compute_block_jacobian(q, start, m, with_pose, derivatives)
        else:
            if changed or not settled:
                take_parameters(parameters, n_joints, derivatives)
            compute_block_jacobian(q, start, m, parameters, derivatives)
        settled = not changed
        if posed:
            _weigh(rows, count, n_joints, program, work, derivatives, m, places)
        low = 0
        while low < m:
            high = low + 1
            while high < m and not begins[high]:
                high += 1
            if begins[low]:
                row = start + low
                if more_c:
                    evaluate(celsius[row], unix_s[row], more_c, slow, changes)
                assemble(values[row], changes[2:], parts, matrix, scratch)
                for i in range(n):
                    for j in range(n):
                        padded[i, j] = matrix[i, j] / (parts.scale[i] * parts.scale[j])
            _multiply(padded, flat_derivatives, places, low, high, along, total)
            low = high
        for i in range(m):
            for part in range(6):
                covariance[start + i, part] = total[part * W + i]
            covariance[start + i, 0] += floor
            covariance[start + i, 3] += floor
            covariance[start + i, 5] += floor


@jit
def _take_column(folded: Folded, i: int, parameters: F64, coefficients: F64) -> None:
    """Store the folded parameters and coefficients as those of sample *i* of the block."""
    for p in range(len(parameters)):
        parameters[p, i] = folded.parameters[p]
    for t in range(len(coefficients)):
        coefficients[t, i] = folded.coefficients[t]


@jit
def _add_pose_terms(
    parameters: F64, coefficients: F64, program: Program, work: Work, m: int, with_pose: F64
) -> None:
    """Fill *with_pose* (P, W) with the parameters of each sample, including its pose terms."""
    for p in range(len(parameters)):
        for i in range(W):
            with_pose[p, i] = parameters[p, i]
    for t in range(len(coefficients)):
        for i in range(m):
            change = coefficients[t, i] * compute_pose_basis(program, work, t, i)
            with_pose[program.parameter[t], i] += change


@jit
def _places(rows: I64, count: int, n_joints: int, padded: int, derivatives: F64) -> I64:
    """Return the offsets of the derivatives by each of *rows* (R,) in *derivatives*.

    They are the flat indices of the x, y, z of a block's samples. Pose terms and zero rows, up to
    *padded* rows, are at the end.
    """
    places = np.empty(padded, np.int64)
    zeros = len(derivatives) - 3
    following = zeros
    for row in range(padded):
        if row >= len(rows):
            first = zeros
        elif rows[row] < count:
            first = find_row(rows[row], n_joints)
        else:
            following -= 3
            first = following
        places[row] = first * W
    return places


@jit
def _weigh(
    rows: I64, count: int, n_joints: int, program: Program, work: Work, derivatives: F64, m: int,
    places: I64,
) -> None:  # fmt: skip
    """Fill the derivatives of the tip by the coefficient of each pose term."""
    for row in range(len(rows)):
        if rows[row] >= count:
            for i in range(m):
                column, weight = find_weight(rows[row], count, program, work, i)
                source, target = find_row(column, n_joints), places[row] // W
                for axis in range(3):
                    derivatives[target + axis, i] = weight * derivatives[source + axis, i]


@jit
def _multiply(
    matrix: F64, moved: F64, places: I64, low: int, high: int, along: F64, total: F64
) -> None:
    """Add J Σ J' of the samples *low* … *high* − 1 of a block, all of one *matrix*, to *total*."""
    for part in range(6):
        for i in range(low, high):
            total[part * W + i] = 0.0
    is_whole = low == 0 and high == W
    n = AXES if is_whole else high - low
    # Views begin where a loop begins: LLVM does not vectorise a loop whose index may be negative.
    for a in range(0, len(matrix), 4):
        for j in range(4 * AXES):
            along[j] = 0.0
        for since in range(low, AXES, AXES if is_whole else W):
            sums = along[since:]
            for b in range(0, a, 4):
                _add_sixteen(
                    matrix, a, b, moved[places[b] + since :], moved[places[b + 1] + since :],
                    moved[places[b + 2] + since :], moved[places[b + 3] + since :], n, sums,
                )  # fmt: skip
            _add_within(
                matrix, a, moved[places[a] + since :], moved[places[a + 1] + since :],
                moved[places[a + 2] + since :], n, sums,
            )  # fmt: skip
        for r in range(4):
            weight, single = matrix[a + r, a + r], moved[places[a + r] + low :]
            _add_products(weight, single, along[r * AXES + low :], high - low, total[low:])


@jit
def _add_sixteen(
    matrix: F64, a: int, b: int, p: F64, r: F64, s: F64, t: F64, n: int, along: F64
) -> None:
    """Add four rows p, r, s, t, by the weights of rows *a* … and columns *b* …, to *along*."""
    a0, a1, a2, a3 = matrix[a, b], matrix[a, b + 1], matrix[a, b + 2], matrix[a, b + 3]
    a += 1
    b0, b1, b2, b3 = matrix[a, b], matrix[a, b + 1], matrix[a, b + 2], matrix[a, b + 3]
    a += 1
    c0, c1, c2, c3 = matrix[a, b], matrix[a, b + 1], matrix[a, b + 2], matrix[a, b + 3]
    a += 1
    d0, d1, d2, d3 = matrix[a, b], matrix[a, b + 1], matrix[a, b + 2], matrix[a, b + 3]
    for j in range(n):
        along[j] += a0 * p[j] + a1 * r[j] + a2 * s[j] + a3 * t[j]
        along[AXES + j] += b0 * p[j] + b1 * r[j] + b2 * s[j] + b3 * t[j]
        along[2 * AXES + j] += c0 * p[j] + c1 * r[j] + c2 * s[j] + c3 * t[j]
        along[3 * AXES + j] += d0 * p[j] + d1 * r[j] + d2 * s[j] + d3 * t[j]


@jit
def _add_within(matrix: F64, a: int, p: F64, r: F64, s: F64, n: int, along: F64) -> None:
    """Add the products of `_add_sixteen` within the four rows, for columns before each row."""
    b0 = matrix[a + 1, a]
    c0, c1 = matrix[a + 2, a], matrix[a + 2, a + 1]
    d0, d1, d2 = matrix[a + 3, a], matrix[a + 3, a + 1], matrix[a + 3, a + 2]
    for j in range(n):
        along[AXES + j] += b0 * p[j]
        along[2 * AXES + j] += c0 * p[j] + c1 * r[j]
        along[3 * AXES + j] += d0 * p[j] + d1 * r[j] + d2 * s[j]


@jit
def _add_products(weight: float, moved: F64, along: F64, n: int, total: F64) -> None:
    """Add one row's products to a block's covariances (6 W,).

    The products are with itself by *weight*, and with *along* (3 W,), the weighted sum of all rows
    before it.
    """
    for i in range(n):
        x, y, z = moved[i], moved[W + i], moved[2 * W + i]
        along_x, along_y, along_z = along[i], along[W + i], along[2 * W + i]
        total[i] += (2 * along_x + weight * x) * x
        total[3 * W + i] += (2 * along_y + weight * y) * y
        total[5 * W + i] += (2 * along_z + weight * z) * z
        total[W + i] += along_x * y + (along_y + weight * y) * x
        total[2 * W + i] += along_z * x + (along_x + weight * x) * z
        total[4 * W + i] += along_z * y + (along_y + weight * y) * z

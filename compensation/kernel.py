"""The kernel: angles in, corrected points out, many samples at once or one.

What depends on temperature and time alone is folded beforehand (`fold`) into one constant 3 × 4
matrix per joint, A = Rz(q)·[Rz(θ0)·Tz(d)·Tx(a)·Rx(α)·Ry(β)], so a sample pays for the sines and
cosines of its joints, for those joints that have pose-dependent terms, and for nothing else.

Samples are worked off in blocks of 64, one row of a small array per quantity, every inner loop
running over the samples of the block without a call or a branch, so that LLVM turns it into
vector instructions; each such loop is a function of its own, for LLVM leaves loops within loops
alone. A live sample is a block of one and takes the same path; the result does not
depend on how the samples were cut into calls.

Rows of a work array are addressed by constants or by one offset plus constants: that is how LLVM
proves that they do not overlap.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from armd.jit import jit

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

BLOCK = 64

# What a pose factor is: its row in `Program.factors` is (kind, joint or link from 0, detail).
SIN, COS, ANGLE, CURVE, TORQUE, DIRECTION, MOMENT, SIDE, RATE, APPROACH, APPROACH_TIP = range(11)

# π/2 in three parts, the first two short enough for exact products (Cody and Waite).
_HALF_PI_1 = 2 * 7.85398125648498535156e-1
_HALF_PI_2 = 2 * 3.77489470793079817668e-8
_HALF_PI_3 = 2 * 2.69515142907905952645e-15


class Amounts(NamedTuple):
    """How much of a term a unit of its slow factors gives."""

    slow_parameter: I64  # (L,) index of the parameter a slow term changes
    slow: F64  # (L,) coefficients of the slow terms
    pose: F64  # (T,) coefficients of the pose terms, in the order of the program


class Folded(NamedTuple):
    """Everything that changes with a temperature or the hour, and nothing that does with a pose."""

    plain: F64  # (N+1, 3, 4) base, joint 1 … N by the constants alone
    matrices: F64  # (N+1, 3, 4) by the constants and the slow terms
    parameters: F64  # (P,) constants and slow terms
    constants: F64  # (P,) constants alone
    coefficients: F64  # (T,) of the pose terms, times their slow factors


class Program(NamedTuple):
    """The pose terms of a calibration, ordered by the group of parameters they change."""

    parameter: I64  # (T,) index of the parameter
    first: I64  # (N+3,) first term of joint 1 … N, tip, base; and the end
    factor_first: I64  # (T+1,) where a term's factors begin in `term_factors`
    term_factors: I64  # rows of `factors`
    factors: I64  # (F, 3) distinct factors: kind, joint or link from 0, detail
    curve_pieces: I64  # (F,) number of pieces of a curve
    needs: I64  # (3,) whether levers under gravity, gravity in links, approach in links are asked
    curves: F64  # (C, 4) cubic pieces, lowest power first; a curve begins at its `detail`
    # (N+1, 4) row 0: unit gravity in the base frame; row k: mass moment of link k (3) and mass
    # carried from it on, both scaled so that moments come out in Nm
    gravity: F64


class Work(NamedTuple):
    """Scratch of one model, a block wide."""

    angle: F64  # (N, B)
    trig: F64  # (2N, B) sine and cosine of each joint
    vectors: F64  # (12, B) tip, x and y axis of the last frame, uncorrected tip: on their way to,
    # and in the end in, the base frame
    posed: F64  # (12, B) one joint's five parameters (or the base's six), and three sines, cosines
    product: F64  # (1, B)
    factors: F64  # (F, B)
    down: F64  # (3N+3, B) gravity in base and link frames
    lever: F64  # (3N+3, B) mass moment of all links beyond, about a link's end, in its frame
    toward: F64  # (3N+3, B) approach in base and link frames


class State(NamedTuple):
    """A model as one compiled call takes it.

    Each array that crosses from Python costs 0.05 µs and each in a tuple 0.15 µs, so three flat
    ones cross and `opened` makes views of them.
    """

    sizes: I64  # N, T, F, C and length of term_factors; then the integers of the program
    numbers: F64  # Folded, then the floats of the program
    work: F64  # (rows, B)


@jit
def opened(state: State) -> tuple[Folded, Program, Work]:
    """Views of the flat arrays, in the order in which the tuples are declared."""
    n, t, f, c, listed = state.sizes[:5]
    i = state.sizes[5:]
    parameter, i = i[:t], i[t:]
    first, i = i[: n + 3], i[n + 3 :]
    factor_first, i = i[: t + 1], i[t + 1 :]
    term_factors, i = i[:listed], i[listed:]
    factors, i = i[: 3 * f].reshape(f, 3), i[3 * f :]
    curve_pieces, needs = i[:f], i[f:]
    x, matrix, p = state.numbers, 12 * (n + 1), 5 * n + 9
    plain, x = x[:matrix].reshape(n + 1, 3, 4), x[matrix:]
    matrices, x = x[:matrix].reshape(n + 1, 3, 4), x[matrix:]
    parameters, x = x[:p], x[p:]
    constants, x = x[:p], x[p:]
    coefficients, x = x[:t], x[t:]
    curves, gravity = x[: 4 * c].reshape(c, 4), x[4 * c :].reshape(n + 1, 4)
    w, frames = state.work, 3 * n + 3
    angle, trig, w = w[:n], w[n : 3 * n], w[3 * n :]
    vectors, posed, product, w = w[:12], w[12:24], w[24:25], w[25:]
    values, w = w[:f], w[f:]
    down, lever, toward = w[:frames], w[frames : 2 * frames], w[2 * frames :]
    return (
        Folded(plain, matrices, parameters, constants, coefficients),
        Program(
            parameter, first, factor_first, term_factors, factors, curve_pieces, needs,
            curves, gravity,
        ),
        Work(angle, trig, vectors, posed, product, values, down, lever, toward),
    )  # fmt: skip


@jit
def fold(values: F64, amounts: Amounts, state: State) -> None:
    """Bring a model to the slow factors' values (L+T,), slow terms first."""
    folded, _, _ = opened(state)
    slow = len(amounts.slow)
    parameters = folded.parameters
    parameters[:] = folded.constants
    for t in range(slow):
        parameters[amounts.slow_parameter[t]] += amounts.slow[t] * values[t]
    for t in range(len(amounts.pose)):
        folded.coefficients[t] = amounts.pose[t] * values[slow + t]
    set_matrices(folded.constants, folded.plain)
    set_matrices(parameters, folded.matrices)


@jit
def set_matrices(parameters: F64, matrices: F64) -> None:
    """Matrices (N+1, 3, 4) of parameters (P,): the base's, then each joint's but for Rz(q)."""
    n_joints = len(matrices) - 1
    base = parameters[5 * n_joints + 3 :]
    cx, sx = math.cos(base[3]), math.sin(base[3])
    cy, sy = math.cos(base[4]), math.sin(base[4])
    cz, sz = math.cos(base[5]), math.sin(base[5])
    matrix = matrices[0]
    matrix[0, 0], matrix[0, 1] = cz * cy, cz * sy * sx - sz * cx
    matrix[1, 0], matrix[1, 1] = sz * cy, sz * sy * sx + cz * cx
    matrix[2, 0], matrix[2, 1], matrix[2, 2] = -sy, cy * sx, cy * cx
    matrix[0, 2] = cz * sy * cx + sz * sx
    matrix[1, 2] = sz * sy * cx - cz * sx
    for axis in range(3):
        matrix[axis, 3] = base[axis]
    for k in range(n_joints):
        theta, d, a, alpha, beta = parameters[5 * k : 5 * k + 5]
        ct, st = math.cos(theta), math.sin(theta)
        ca, sa = math.cos(alpha), math.sin(alpha)
        cb, sb = math.cos(beta), math.sin(beta)
        matrix = matrices[k + 1]
        matrix[0, 0], matrix[0, 1] = ct * cb - st * sa * sb, -st * ca
        matrix[1, 0], matrix[1, 1] = st * cb + ct * sa * sb, ct * ca
        matrix[0, 2], matrix[0, 3] = ct * sb + st * sa * cb, ct * a
        matrix[1, 2], matrix[1, 3] = st * sb - ct * sa * cb, st * a
        matrix[2, 0], matrix[2, 1] = -ca * sb, sa
        matrix[2, 2], matrix[2, 3] = ca * cb, d


@jit
def uncorrected(q: F64, state: State, position: F64) -> None:
    """Tip positions (n, 3) mm by the constants alone."""
    folded, _, work = opened(state)
    angle, trig, vectors = work.angle, work.trig, work.vectors
    tip = folded.constants[5 * len(angle) :]
    for start in range(0, len(q), BLOCK):
        m = min(BLOCK, len(q) - start)
        take_angles(q, start, m, angle, trig)
        to_world(folded.plain, tip, trig, vectors, 0)
        for i in range(m):
            for axis in range(3):
                position[start + i, axis] = vectors[axis, i]


@jit
def correct(q: F64, rate: F64, approach: F64, state: State, position: F64, correction: F64) -> None:
    """Tip positions (n, 3) mm and, unless its length is 0, corrections (n, 3) mm."""
    folded, program, work = opened(state)
    angle, trig, vectors = work.angle, work.trig, work.vectors
    tip, plain_tip = folded.parameters[5 * len(angle) :], folded.constants[5 * len(angle) :]
    for start in range(0, len(q), BLOCK):
        m = min(BLOCK, len(q) - start)
        take_angles(q, start, m, angle, trig)
        if len(program.parameter):
            to_world_posed(rate, approach, start, m, folded, program, work, 1)
        else:
            to_world(folded.matrices, tip, trig, vectors, 0)
        for i in range(m):
            for axis in range(3):
                position[start + i, axis] = vectors[axis, i]
        if len(correction):
            to_world(folded.plain, plain_tip, trig, vectors, 9)
            for i in range(m):
                for axis in range(3):
                    correction[start + i, axis] = vectors[axis, i] - vectors[9 + axis, i]


@jit
def correct_runs(
    values: F64, amounts: Amounts, q: F64, rate: F64, approach: F64, state: State,
    position: F64, correction: F64,
) -> None:  # fmt: skip
    """Correct n samples, row i under its own *values* (n, L+T); equal neighbours share a fold."""
    first = 0
    while first < len(values):
        end = first + 1
        while end < len(values) and (values[end] == values[first]).all():
            end += 1
        fold(values[first], amounts, state)
        correct(
            q[first:end], rate[first:end], approach[first:end], state,
            position[first:end], correction[first:end],
        )  # fmt: skip
        first = end


@jit
def take_angles(q: F64, start: int, m: int, angle: F64, trig: F64) -> None:
    """Angles of m samples, their sines and cosines."""
    n_joints = q.shape[1]
    for i in range(m):
        for k in range(n_joints):
            angle[k, i] = q[start + i, k]
    _sincos(angle, 0, n_joints, 1.0, trig, 0)


@jit
def to_world(matrices: F64, tip: F64, trig: F64, vectors: F64, v: int) -> None:
    """Rows v … v + 2 of *vectors*: the tip (v = 0 or 9), or the x and y axes of the last frame
    (v = 3 takes both), in the world."""
    _start(vectors, v, tip)
    _fixed(matrices, len(matrices) - 1, 0, trig, vectors, v)
    if v == 3:
        _fixed(matrices, len(matrices) - 1, 0, trig, vectors, 6)


@jit
def to_world_posed(
    rate: F64, approach: F64, start: int, m: int, folded: Folded, program: Program, work: Work,
    turned: int,
) -> None:  # fmt: skip
    """Like `to_world` with pose terms: the tip, and if *turned* is 3 the two axes."""
    vectors, n_joints, first = work.vectors, len(work.angle), program.first
    _start(vectors, 0, folded.parameters[5 * n_joints :])
    _start(vectors, 3, folded.parameters)
    _evaluate_factors(rate, approach, start, folded.plain, program, work, m)
    if first[n_joints] < first[n_joints + 1]:
        _spread(n_joints, 5 * n_joints, 3, folded, program, work)
        for axis in range(3):
            for i in range(BLOCK):
                vectors[axis, i] = work.posed[axis, i]
    k = n_joints
    while k >= 0:
        if _has_pose_terms(k, first):
            if k > 0:
                _posed_joint(k - 1, folded, program, work, turned)
            else:
                _posed_base(n_joints, folded, program, work, turned)
            k -= 1
            continue
        low = k
        while low > 0 and not _has_pose_terms(low - 1, first):
            low -= 1
        for v in range(0, 3 * turned, 3):
            _fixed(folded.matrices, k, low, work.trig, vectors, v)
        k = low - 1


@jit
def _has_pose_terms(k: int, first: I64) -> bool:
    """Whether joint k (from 1), or the base for k = 0, differs from sample to sample."""
    group = k - 1 if k > 0 else len(first) - 2
    return bool(first[group] < first[group + 1])


@jit
def _sincos(angle: F64, first: int, rows: int, order: float, out: F64, to: int) -> None:
    """Sines and cosines of order · angle, error below 2e-16, in turn from row *to* of *out* on.

    Reduction to ±π/4 by multiples of π/2, minimax polynomials (Cephes), quadrant by arithmetic.
    """
    for k in range(rows):
        _sincos_row(angle, first + k, order, out, to + 2 * k)


@jit
def _sincos_row(angle: F64, row: int, order: float, out: F64, to: int) -> None:
    for i in range(BLOCK):
        x = order * angle[row, i]
        j = np.floor(x * (2 / math.pi) + 0.5)
        r = ((x - j * _HALF_PI_1) - j * _HALF_PI_2) - j * _HALF_PI_3
        z = r * r
        s = 1.58962301576546568060e-10 * z - 2.50507477628578072866e-8
        s = s * z + 2.75573136213857245213e-6
        s = s * z - 1.98412698295895385996e-4
        s = s * z + 8.33333333332211858878e-3
        s = s * z - 1.66666666666666307295e-1
        s = r + r * z * s
        c = -1.13585365213876817300e-11 * z + 2.08757008419747316778e-9
        c = c * z - 2.75573141792967388112e-7
        c = c * z + 2.48015872888517045348e-5
        c = c * z - 1.38888888888730564116e-3
        c = c * z + 4.16666666666665929218e-2
        c = 1.0 - 0.5 * z + z * z * c
        half = np.floor(j * 0.5)
        odd = j - 2.0 * half != 0.0
        sign = 1.0 - 2.0 * (half - 2.0 * np.floor(half * 0.5))  # −1 in the quadrants 2 and 3
        out[to, i] = sign * (c if odd else s)
        out[to + 1, i] = sign * (-s if odd else c)


@jit
def _start(vectors: F64, v: int, tip: F64) -> None:
    """Rows v … v + 2: the tip's offset; from v = 3 on: the x and the y axis. In the last frame."""
    if v == 3:
        for row in range(3, 9):
            value = 1.0 if row in (3, 7) else 0.0
            for i in range(BLOCK):
                vectors[row, i] = value
        return
    for axis in range(3):
        value = tip[axis]
        for i in range(BLOCK):
            vectors[v + axis, i] = value


@jit
def _fixed(matrices: F64, high: int, low: int, trig: F64, vectors: F64, v: int) -> None:
    """Take rows v … v + 2 from link *high* through the joints *high* … *low*.

    That is to link *low* − 1; *low* = 0 takes them through the base to the world as well. Rows
    3–8 are axes, which have no place.
    """
    place = 0.0 if 3 <= v < 9 else 1.0
    for k in range(high, max(low, 1) - 1, -1):
        _fixed_joint(matrices, k, place, trig, vectors, v)
    if low == 0 and _displaced(matrices):
        _fixed_base(matrices, place, vectors, v)


@jit
def _fixed_joint(matrices: F64, k: int, place: float, trig: F64, vectors: F64, v: int) -> None:
    m00, m01, m02, m03 = matrices[k, 0, 0], matrices[k, 0, 1], matrices[k, 0, 2], matrices[k, 0, 3]
    m10, m11, m12, m13 = matrices[k, 1, 0], matrices[k, 1, 1], matrices[k, 1, 2], matrices[k, 1, 3]
    m20, m21, m22, m23 = matrices[k, 2, 0], matrices[k, 2, 1], matrices[k, 2, 2], matrices[k, 2, 3]
    m03, m13, m23 = m03 * place, m13 * place, m23 * place
    sine = 2 * (k - 1)
    for i in range(BLOCK):
        x, y, z = vectors[v, i], vectors[v + 1, i], vectors[v + 2, i]
        s, c = trig[sine, i], trig[sine + 1, i]
        along = m00 * x + m01 * y + m02 * z + m03
        across = m10 * x + m11 * y + m12 * z + m13
        vectors[v, i] = c * along - s * across
        vectors[v + 1, i] = s * along + c * across
        vectors[v + 2, i] = m20 * x + m21 * y + m22 * z + m23


@jit
def _displaced(matrices: F64) -> bool:
    """Whether the base does not stand where the drawing has it, which is rare."""
    for row in range(3):
        for column in range(4):
            if matrices[0, row, column] != (1.0 if row == column else 0.0):
                return True
    return False


@jit
def _fixed_base(matrices: F64, place: float, vectors: F64, v: int) -> None:
    m00, m01, m02, m03 = matrices[0, 0, 0], matrices[0, 0, 1], matrices[0, 0, 2], matrices[0, 0, 3]
    m10, m11, m12, m13 = matrices[0, 1, 0], matrices[0, 1, 1], matrices[0, 1, 2], matrices[0, 1, 3]
    m20, m21, m22, m23 = matrices[0, 2, 0], matrices[0, 2, 1], matrices[0, 2, 2], matrices[0, 2, 3]
    m03, m13, m23 = m03 * place, m13 * place, m23 * place
    for i in range(BLOCK):
        x, y, z = vectors[v, i], vectors[v + 1, i], vectors[v + 2, i]
        vectors[v, i] = m00 * x + m01 * y + m02 * z + m03
        vectors[v + 1, i] = m10 * x + m11 * y + m12 * z + m13
        vectors[v + 2, i] = m20 * x + m21 * y + m22 * z + m23


@jit
def _spread(
    group: int, offset: int, rows: int, folded: Folded, program: Program, work: Work
) -> None:
    """A group's parameters from *offset* on, sample by sample: rows of `work.posed`."""
    for row in range(rows):
        value = folded.parameters[offset + row]
        for i in range(BLOCK):
            work.posed[row, i] = value
    product = work.product
    for t in range(program.first[group], program.first[group + 1]):
        coefficient = folded.coefficients[t]
        for i in range(BLOCK):
            product[0, i] = coefficient
        for j in range(program.factor_first[t], program.factor_first[t + 1]):
            f = program.term_factors[j]
            for i in range(BLOCK):
                product[0, i] *= work.factors[f, i]
        row = program.parameter[t] - offset
        for i in range(BLOCK):
            work.posed[row, i] += product[0, i]


@jit
def _posed_joint(k: int, folded: Folded, program: Program, work: Work, turned: int) -> None:
    """Like `_fixed` for joint k (from 0), its five parameters differing from sample to sample."""
    _spread(k, 5 * k, 5, folded, program, work)
    posed, angle, vectors = work.posed, work.angle, work.vectors
    for i in range(BLOCK):
        posed[0, i] += angle[k, i]
    _sincos(posed, 0, 1, 1.0, posed, 6)
    _sincos(posed, 3, 2, 1.0, posed, 8)
    for v in range(0, 3 * turned, 3):
        shift = 1.0 if v == 0 else 0.0
        for i in range(BLOCK):
            x, y, z = vectors[v, i], vectors[v + 1, i], vectors[v + 2, i]
            x, z = posed[11, i] * x + posed[10, i] * z, posed[11, i] * z - posed[10, i] * x
            y, z = posed[9, i] * y - posed[8, i] * z, posed[8, i] * y + posed[9, i] * z
            x += shift * posed[2, i]
            vectors[v, i] = posed[7, i] * x - posed[6, i] * y
            vectors[v + 1, i] = posed[6, i] * x + posed[7, i] * y
            vectors[v + 2, i] = z + shift * posed[1, i]


@jit
def _posed_base(n_joints: int, folded: Folded, program: Program, work: Work, turned: int) -> None:
    """The base's displacement, differing from sample to sample."""
    _spread(n_joints + 1, 5 * n_joints + 3, 6, folded, program, work)
    posed, vectors = work.posed, work.vectors
    _sincos(posed, 3, 3, 1.0, posed, 6)
    for v in range(0, 3 * turned, 3):
        shift = 1.0 if v == 0 else 0.0
        for i in range(BLOCK):
            x, y, z = vectors[v, i], vectors[v + 1, i], vectors[v + 2, i]
            y, z = posed[7, i] * y - posed[6, i] * z, posed[6, i] * y + posed[7, i] * z
            x, z = posed[9, i] * x + posed[8, i] * z, posed[9, i] * z - posed[8, i] * x
            vectors[v, i] = posed[11, i] * x - posed[10, i] * y + shift * posed[0, i]
            vectors[v + 1, i] = posed[10, i] * x + posed[11, i] * y + shift * posed[1, i]
            vectors[v + 2, i] = z + shift * posed[2, i]


@jit
def quaternion(vectors: F64, i: int) -> tuple[float, float, float, float]:
    """x, y, z, w ≥ 0 of the frame whose x and y axes stand in rows 3–8 (Shepperd's choice)."""
    xx, yx, zx = vectors[3, i], vectors[4, i], vectors[5, i]
    xy, yy, zy = vectors[6, i], vectors[7, i], vectors[8, i]
    xz, yz, zz = yx * zy - zx * yy, zx * xy - xx * zy, xx * yy - yx * xy
    trace = xx + yy + zz
    if trace > max(xx, yy, zz):
        x, y, z, w = zy - yz, xz - zx, yx - xy, 1.0 + trace
    elif xx > yy and xx > zz:
        x, y, z, w = 1.0 + xx - yy - zz, yx + xy, xz + zx, zy - yz
    elif yy > zz:
        x, y, z, w = yx + xy, 1.0 + yy - xx - zz, zy + yz, xz - zx
    else:
        x, y, z, w = xz + zx, zy + yz, 1.0 + zz - xx - yy, yx - xy
    scale = math.copysign(1.0 / math.sqrt(x * x + y * y + z * z + w * w), w)
    return scale * x, scale * y, scale * z, scale * w


@jit
def _evaluate_factors(
    rate: F64, approach: F64, start: int, plain: F64, program: Program, work: Work, m: int
) -> None:
    """Every distinct pose factor, one row of `work.factors` each."""
    factors, trig = work.factors, work.trig
    down, lever = work.down, work.lever
    if program.needs[1]:
        for axis in range(3):
            for i in range(BLOCK):
                down[axis, i] = program.gravity[0, axis]
        _into_links(plain, trig, down)
    if program.needs[0]:
        _levers(plain, trig, program.gravity, lever)
    if program.needs[2]:
        for i in range(m):
            for axis in range(3):
                toward = approach[start + i, axis]
                work.toward[axis, i] = 0.0 if np.isnan(toward) else toward
        _into_links(plain, trig, work.toward)
    for f in range(len(program.factors)):
        kind, k, detail = program.factors[f, 0], program.factors[f, 1], program.factors[f, 2]
        if kind in (SIN, COS):
            which = 0 if kind == SIN else 1
            if detail == 1:
                for i in range(BLOCK):
                    factors[f, i] = trig[2 * k + which, i]
            else:
                _sincos(work.angle, k, 1, float(detail), work.posed, 0)
                for i in range(BLOCK):
                    factors[f, i] = work.posed[which, i]
        elif kind == ANGLE:
            for i in range(BLOCK):
                factors[f, i] = work.angle[k, i] ** detail
        elif kind == CURVE:
            _curve(work.angle, k, program.curves, detail, program.curve_pieces[f], factors, f)
        elif kind == TORQUE:
            a = 3 * k  # the frame before the joint, whose z axis it turns about
            for i in range(BLOCK):
                factors[f, i] = lever[a, i] * down[a + 1, i] - lever[a + 1, i] * down[a, i]
        elif kind == MOMENT:
            a, b = 3 * (k + 1) + (detail + 1) % 3, 3 * (k + 1) + (detail + 2) % 3
            for i in range(BLOCK):
                factors[f, i] = lever[a, i] * down[b, i] - lever[b, i] * down[a, i]
        elif kind == DIRECTION:
            for i in range(BLOCK):
                factors[f, i] = down[3 * (k + 1) + detail, i]
        elif kind == SIDE:
            for i in range(m):
                speed = rate[start + i, k]
                factors[f, i] = 1.0 if speed > 0.0 else -1.0 if speed < 0.0 else 0.0
        elif kind == RATE:
            for i in range(m):
                speed = rate[start + i, k]
                factors[f, i] = 0.0 if np.isnan(speed) else speed
        elif kind == APPROACH:
            for i in range(m):
                toward = approach[start + i, detail]
                factors[f, i] = 0.0 if np.isnan(toward) else toward
        else:
            last = len(work.toward) - 3
            for i in range(BLOCK):
                factors[f, i] = work.toward[last + detail, i]


@jit
def _curve(angle: F64, k: int, curves: F64, at: int, pieces: int, factors: F64, f: int) -> None:
    """A periodic piecewise cubic; pieces are counted from angle 0, their argument is in rad."""
    width = 2 * math.pi / pieces
    for i in range(BLOCK):
        turns = angle[k, i] / (2 * math.pi)
        place = (turns - np.floor(turns)) * pieces
        piece = min(int(place), pieces - 1)
        x = (place - piece) * width
        c = at + piece
        factors[f, i] = curves[c, 0] + x * (curves[c, 1] + x * (curves[c, 2] + x * curves[c, 3]))


@jit
def _into_links(plain: F64, trig: F64, rows: F64) -> None:
    """Turn the vectors of rows 0–2, given in the world, into every frame: rows 3k … 3k + 2.

    Rows 0–2 themselves end in the frame before joint 1.
    """
    for k in range(len(plain)):
        m00, m01, m02 = plain[k, 0, 0], plain[k, 0, 1], plain[k, 0, 2]
        m10, m11, m12 = plain[k, 1, 0], plain[k, 1, 1], plain[k, 1, 2]
        m20, m21, m22 = plain[k, 2, 0], plain[k, 2, 1], plain[k, 2, 2]
        source, to = 3 * max(k - 1, 0), 3 * k
        for i in range(BLOCK):
            x, y, z = rows[source, i], rows[source + 1, i], rows[source + 2, i]
            if k > 0:
                s, c = trig[2 * k - 2, i], trig[2 * k - 1, i]
                x, y = c * x + s * y, c * y - s * x
            rows[to, i] = m00 * x + m10 * y + m20 * z
            rows[to + 1, i] = m01 * x + m11 * y + m21 * z
            rows[to + 2, i] = m02 * x + m12 * y + m22 * z


@jit
def _levers(plain: F64, trig: F64, gravity: F64, lever: F64) -> None:
    """Mass moments (scaled to Nm under unit gravity) of all links beyond a frame, in that frame."""
    last = 3 * (len(plain) - 1)
    for i in range(BLOCK):
        lever[last, i] = lever[last + 1, i] = lever[last + 2, i] = 0.0
    for k in range(len(plain) - 1, 0, -1):
        own_x, own_y, own_z, carried = gravity[k]
        m00, m01, m02, m03 = plain[k, 0, 0], plain[k, 0, 1], plain[k, 0, 2], plain[k, 0, 3]
        m10, m11, m12, m13 = plain[k, 1, 0], plain[k, 1, 1], plain[k, 1, 2], plain[k, 1, 3]
        m20, m21, m22, m23 = plain[k, 2, 0], plain[k, 2, 1], plain[k, 2, 2], plain[k, 2, 3]
        m03, m13, m23 = carried * m03, carried * m13, carried * m23
        a = 3 * k
        for i in range(BLOCK):
            x, y, z = lever[a, i] + own_x, lever[a + 1, i] + own_y, lever[a + 2, i] + own_z
            s, c = trig[2 * k - 2, i], trig[2 * k - 1, i]
            along = m00 * x + m01 * y + m02 * z + m03
            across = m10 * x + m11 * y + m12 * z + m13
            lever[a - 3, i] = c * along - s * across
            lever[a - 2, i] = s * along + c * across
            lever[a - 1, i] = m20 * x + m21 * y + m22 * z + m23

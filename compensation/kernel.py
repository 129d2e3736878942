"""The kernel: angles in, corrected points out, many samples at once or one.

What depends on temperature and time alone is folded beforehand (`fold`) into one constant 3 × 4
matrix per joint, A = Rz(q)·[Rz(θ0)·Tz(d)·Tx(a)·Rx(α)·Ry(β)], so a sample pays for the sines and
cosines of its joints, for those joints that have pose-dependent terms, and for nothing else.

Samples are worked off in blocks of 64, one row of a small array per quantity, every inner loop
running over the samples of the block without a call or a branch, so that LLVM turns it into
vector instructions. A live sample is a block of one and takes the same path; the result does not
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


class Folded(NamedTuple):
    """Everything that changes with a temperature or the hour, and nothing that does with a pose."""

    plain: F64  # (N+1, 3, 4) base, joint 1 … N by the constants alone
    matrices: F64  # (N+1, 3, 4) by the constants and the slow terms
    parameters: F64  # (P,) constants and slow terms
    constants: F64  # (P,) constants alone
    coefficients: F64  # (T,) of the pose terms, times their slow factors


class Amounts(NamedTuple):
    """How much of a term a unit of its slow factors gives."""

    slow_parameter: I64  # (L,) index of the parameter a slow term changes
    slow: F64  # (L,) coefficients of the slow terms
    pose: F64  # (T,) coefficients of the pose terms, in the order of the program


class Program(NamedTuple):
    """The pose terms of a calibration, ordered by the group of parameters they change."""

    parameter: I64  # (T,) index of the parameter
    first: I64  # (N+3,) first term of joint 1 … N, tip, base; and the end
    factor_first: I64  # (T+1,) where a term's factors begin in `term_factors`
    term_factors: I64  # rows of `factors`
    factors: I64  # (F, 3) distinct factors: kind, joint or link from 0, detail
    curves: F64  # (C, 4) cubic pieces, lowest power first; a curve begins at its `detail`
    curve_pieces: I64  # (F,) number of pieces of a curve
    gravity: F64  # (N+1, 4) row k: mass moment (3) kg·mm and mass carried from link k on, kg;
    # row 0: unit gravity in the base frame
    needs: I64  # (3,) whether levers under gravity, gravity in links, approach in links are asked


class Work(NamedTuple):
    """Scratch of one model, a block wide."""

    angle: F64  # (N, B)
    trig: F64  # (2N, B) sine and cosine of each joint
    vectors: F64  # (9, B) position and two axes on their way from the tip to the base
    posed: F64  # (12, B) one joint's five parameters (or the base's six), and three sines, cosines
    factors: F64  # (F, B)
    product: F64  # (1, B)
    down: F64  # (3N+3, B) gravity in base and link frames
    lever: F64  # (3N+3, B) mass moment of all links beyond, about a link's end, in its frame
    toward: F64  # (3N+3, B) approach in base and link frames


class Inputs(NamedTuple):
    q: F64  # (n, N) rad
    rate: F64  # (n, N) rad/s, NaN missing; the sign is the side of approach
    approach: F64  # (n, 3) NaN missing


class Outputs(NamedTuple):
    """An output of length 0 is not computed."""

    position: F64  # (n, 3) mm
    orientation: F64  # (n, 4) quaternion x y z w of the last frame, w ≥ 0
    correction: F64  # (n, 3) mm
    basis: F64  # (n, T) values of the pose terms' pose factors


@jit
def fold(values: F64, amounts: Amounts, folded: Folded) -> None:
    """Bring *folded* to the slow factors' values (L+T,), slow terms first."""
    slow = len(amounts.slow)
    parameters = folded.parameters
    parameters[:] = folded.constants
    for t in range(slow):
        parameters[amounts.slow_parameter[t]] += amounts.slow[t] * values[t]
    for t in range(len(amounts.pose)):
        folded.coefficients[t] = amounts.pose[t] * values[slow + t]
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
def correct(inputs: Inputs, folded: Folded, program: Program, work: Work, out: Outputs) -> None:
    """Correct n samples under one folded state."""
    n, n_joints = inputs.q.shape
    vectors = work.vectors
    turned = 3 if len(out.orientation) else 1  # the position alone, or two axes with it
    posed = len(program.parameter) > 0
    for start in range(0, n, BLOCK):
        m = min(BLOCK, n - start)
        for i in range(m):
            for k in range(n_joints):
                work.angle[k, i] = inputs.q[start + i, k]
        for k in range(n_joints):
            _sincos(work.angle, k, 1.0, work.trig, 2 * k, m)

        if len(out.correction):
            _start(vectors, folded.constants, n_joints, 1, m)
            for k in range(n_joints, -1, -1):
                _fixed(folded.plain, k, work.trig, vectors, 1, m)
            for i in range(m):
                for axis in range(3):
                    out.correction[start + i, axis] = -vectors[axis, i]

        _start(vectors, folded.parameters, n_joints, turned, m)
        if posed:
            _evaluate_factors(inputs, start, folded.plain, program, work, m)
            if len(out.basis):
                _write_basis(program, work, out.basis, start, m)
            if program.first[n_joints] < program.first[n_joints + 1]:
                _spread(n_joints, 3, folded, program, work, m)
                for axis in range(3):
                    for i in range(m):
                        vectors[axis, i] = work.posed[axis, i]
        for k in range(n_joints, 0, -1):
            if posed and program.first[k - 1] < program.first[k]:
                _posed_joint(k - 1, folded, program, work, turned, m)
            else:
                _fixed(folded.matrices, k, work.trig, vectors, turned, m)
        if posed and program.first[n_joints + 1] < program.first[n_joints + 2]:
            _posed_base(n_joints, folded, program, work, turned, m)
        else:
            _fixed(folded.matrices, 0, work.trig, vectors, turned, m)

        for i in range(m):
            for axis in range(3):
                out.position[start + i, axis] = vectors[axis, i]
        if len(out.correction):
            for i in range(m):
                for axis in range(3):
                    out.correction[start + i, axis] += vectors[axis, i]
        if turned == 3:
            _quaternions(vectors, out.orientation, start, m)


@jit
def correct_runs(
    values: F64,
    amounts: Amounts,
    inputs: Inputs,
    folded: Folded,
    program: Program,
    work: Work,
    out: Outputs,
) -> None:
    """Correct n samples, row i under its own *values* (n, L+T); equal neighbours share a fold."""
    n = len(values)
    first = 0
    while first < n:
        end = first + 1
        while end < n and (values[end] == values[first]).all():
            end += 1
        fold(values[first], amounts, folded)
        run = Inputs(inputs.q[first:end], inputs.rate[first:end], inputs.approach[first:end])
        correct(
            run, folded, program, work,
            Outputs(
                out.position[first:end], out.orientation[first:end],
                out.correction[first:end], out.basis[first:end],
            ),
        )  # fmt: skip
        first = end


@jit
def _sincos(angle: F64, row: int, order: float, out: F64, to: int, m: int) -> None:
    """Rows *to* and *to* + 1 of *out*: sine and cosine of order · angle, error below 2e-16.

    Reduction to ±π/4 by multiples of π/2, minimax polynomials (Cephes), quadrant by arithmetic.
    """
    for i in range(m):
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
def _start(vectors: F64, parameters: F64, n_joints: int, turned: int, m: int) -> None:
    """The tip's offset and, if asked, the x and y axes, in the last frame."""
    for row in range(3 * turned):
        value = parameters[5 * n_joints + row] if row < 3 else 1.0 if row in (3, 7) else 0.0
        for i in range(m):
            vectors[row, i] = value


@jit
def _fixed(matrices: F64, k: int, trig: F64, vectors: F64, turned: int, m: int) -> None:
    """Take vectors from link k to link k − 1 (k = 0: from the base frame to the world)."""
    m00, m01, m02, m03 = matrices[k, 0, 0], matrices[k, 0, 1], matrices[k, 0, 2], matrices[k, 0, 3]
    m10, m11, m12, m13 = matrices[k, 1, 0], matrices[k, 1, 1], matrices[k, 1, 2], matrices[k, 1, 3]
    m20, m21, m22, m23 = matrices[k, 2, 0], matrices[k, 2, 1], matrices[k, 2, 2], matrices[k, 2, 3]
    for v in range(0, 3 * turned, 3):
        if v == 3:
            m03 = m13 = m23 = 0.0  # axes have no place
        if k == 0:
            for i in range(m):
                x, y, z = vectors[v, i], vectors[v + 1, i], vectors[v + 2, i]
                vectors[v, i] = m00 * x + m01 * y + m02 * z + m03
                vectors[v + 1, i] = m10 * x + m11 * y + m12 * z + m13
                vectors[v + 2, i] = m20 * x + m21 * y + m22 * z + m23
        else:
            sine = 2 * (k - 1)
            for i in range(m):
                x, y, z = vectors[v, i], vectors[v + 1, i], vectors[v + 2, i]
                s, c = trig[sine, i], trig[sine + 1, i]
                along = m00 * x + m01 * y + m02 * z + m03
                across = m10 * x + m11 * y + m12 * z + m13
                vectors[v, i] = c * along - s * across
                vectors[v + 1, i] = s * along + c * across
                vectors[v + 2, i] = m20 * x + m21 * y + m22 * z + m23


@jit
def _spread(
    group: int, rows: int, folded: Folded, program: Program, work: Work, m: int
) -> None:  # fmt: skip
    """Parameters of a group, sample by sample: rows of `work.posed`."""
    offset = 5 * group if rows != 6 else 5 * (group - 1) + 3
    for row in range(rows):
        value = folded.parameters[offset + row]
        for i in range(m):
            work.posed[row, i] = value
    product = work.product
    for t in range(program.first[group], program.first[group + 1]):
        coefficient = folded.coefficients[t]
        for i in range(m):
            product[0, i] = coefficient
        for j in range(program.factor_first[t], program.factor_first[t + 1]):
            f = program.term_factors[j]
            for i in range(m):
                product[0, i] *= work.factors[f, i]
        row = program.parameter[t] - offset
        for i in range(m):
            work.posed[row, i] += product[0, i]


@jit
def _posed_joint(k: int, folded: Folded, program: Program, work: Work, turned: int, m: int) -> None:
    """Like `_fixed` for joint k (from 0), its five parameters differing from sample to sample."""
    _spread(k, 5, folded, program, work, m)
    posed, angle, vectors = work.posed, work.angle, work.vectors
    for i in range(m):
        posed[0, i] += angle[k, i]
    _sincos(posed, 0, 1.0, posed, 6, m)
    _sincos(posed, 3, 1.0, posed, 8, m)
    _sincos(posed, 4, 1.0, posed, 10, m)
    for v in range(0, 3 * turned, 3):
        shift = 1.0 if v == 0 else 0.0
        for i in range(m):
            x, y, z = vectors[v, i], vectors[v + 1, i], vectors[v + 2, i]
            x, z = posed[11, i] * x + posed[10, i] * z, posed[11, i] * z - posed[10, i] * x
            y, z = posed[9, i] * y - posed[8, i] * z, posed[8, i] * y + posed[9, i] * z
            x += shift * posed[2, i]
            vectors[v, i] = posed[7, i] * x - posed[6, i] * y
            vectors[v + 1, i] = posed[6, i] * x + posed[7, i] * y
            vectors[v + 2, i] = z + shift * posed[1, i]


@jit
def _posed_base(
    n_joints: int, folded: Folded, program: Program, work: Work, turned: int, m: int
) -> None:
    """The base's displacement, differing from sample to sample."""
    _spread(n_joints + 1, 6, folded, program, work, m)
    posed, vectors = work.posed, work.vectors
    _sincos(posed, 3, 1.0, posed, 6, m)
    _sincos(posed, 4, 1.0, posed, 8, m)
    _sincos(posed, 5, 1.0, posed, 10, m)
    for v in range(0, 3 * turned, 3):
        shift = 1.0 if v == 0 else 0.0
        for i in range(m):
            x, y, z = vectors[v, i], vectors[v + 1, i], vectors[v + 2, i]
            y, z = posed[7, i] * y - posed[6, i] * z, posed[6, i] * y + posed[7, i] * z
            x, z = posed[9, i] * x + posed[8, i] * z, posed[9, i] * z - posed[8, i] * x
            vectors[v, i] = posed[11, i] * x - posed[10, i] * y + shift * posed[0, i]
            vectors[v + 1, i] = posed[10, i] * x + posed[11, i] * y + shift * posed[1, i]
            vectors[v + 2, i] = z + shift * posed[2, i]


@jit
def _quaternions(vectors: F64, orientation: F64, start: int, m: int) -> None:
    """Quaternions of the frames whose x and y axes stand in rows 3–8 (Shepperd's choice)."""
    for i in range(m):
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
        orientation[start + i, 0] = scale * x
        orientation[start + i, 1] = scale * y
        orientation[start + i, 2] = scale * z
        orientation[start + i, 3] = scale * w


@jit
def _write_basis(program: Program, work: Work, basis: F64, start: int, m: int) -> None:
    for t in range(len(program.parameter)):
        for i in range(m):
            basis[start + i, t] = 1.0
        for j in range(program.factor_first[t], program.factor_first[t + 1]):
            f = program.term_factors[j]
            for i in range(m):
                basis[start + i, t] *= work.factors[f, i]


@jit
def _evaluate_factors(
    inputs: Inputs, start: int, plain: F64, program: Program, work: Work, m: int
) -> None:
    """Every distinct pose factor, one row of `work.factors` each."""
    factors, trig = work.factors, work.trig
    down, lever = work.down, work.lever
    if program.needs[1]:
        for axis in range(3):
            for i in range(m):
                down[axis, i] = program.gravity[0, axis]
        _into_links(plain, trig, down, m)
    if program.needs[0]:
        _levers(plain, trig, program.gravity, lever, m)
    if program.needs[2]:
        for i in range(m):
            for axis in range(3):
                toward = inputs.approach[start + i, axis]
                work.toward[axis, i] = 0.0 if np.isnan(toward) else toward
        _into_links(plain, trig, work.toward, m)
    for f in range(len(program.factors)):
        kind, k, detail = program.factors[f, 0], program.factors[f, 1], program.factors[f, 2]
        if kind in (SIN, COS):
            which = 0 if kind == SIN else 1
            if detail == 1:
                for i in range(m):
                    factors[f, i] = trig[2 * k + which, i]
            else:
                _sincos(work.angle, k, float(detail), work.posed, 0, m)
                for i in range(m):
                    factors[f, i] = work.posed[which, i]
        elif kind == ANGLE:
            for i in range(m):
                factors[f, i] = work.angle[k, i] ** detail
        elif kind == CURVE:
            _curve(work.angle, k, program.curves, detail, program.curve_pieces[f], factors, f, m)
        elif kind == TORQUE:
            a = 3 * k  # the frame before the joint, whose z axis it turns about
            for i in range(m):
                factors[f, i] = lever[a, i] * down[a + 1, i] - lever[a + 1, i] * down[a, i]
        elif kind == MOMENT:
            a, b = 3 * (k + 1) + (detail + 1) % 3, 3 * (k + 1) + (detail + 2) % 3
            for i in range(m):
                factors[f, i] = lever[a, i] * down[b, i] - lever[b, i] * down[a, i]
        elif kind == DIRECTION:
            for i in range(m):
                factors[f, i] = down[3 * (k + 1) + detail, i]
        elif kind == SIDE:
            for i in range(m):
                rate = inputs.rate[start + i, k]
                factors[f, i] = 1.0 if rate > 0.0 else -1.0 if rate < 0.0 else 0.0
        elif kind == RATE:
            for i in range(m):
                rate = inputs.rate[start + i, k]
                factors[f, i] = 0.0 if np.isnan(rate) else rate
        elif kind == APPROACH:
            for i in range(m):
                toward = inputs.approach[start + i, detail]
                factors[f, i] = 0.0 if np.isnan(toward) else toward
        else:
            last = len(work.toward) - 3
            for i in range(m):
                factors[f, i] = work.toward[last + detail, i]


@jit
def _curve(
    angle: F64, k: int, curves: F64, at: int, pieces: int, factors: F64, f: int, m: int
) -> None:
    """A periodic piecewise cubic; pieces are counted from angle 0, their argument is in rad."""
    width = 2 * math.pi / pieces
    for i in range(m):
        turns = angle[k, i] / (2 * math.pi)
        place = (turns - np.floor(turns)) * pieces
        piece = min(int(place), pieces - 1)
        x = (place - piece) * width
        c = at + piece
        factors[f, i] = curves[c, 0] + x * (curves[c, 1] + x * (curves[c, 2] + x * curves[c, 3]))


@jit
def _into_links(plain: F64, trig: F64, rows: F64, m: int) -> None:
    """Turn the vectors of rows 0–2, given in the world, into every frame: rows 3k … 3k + 2.

    Rows 0–2 themselves end in the frame before joint 1.
    """
    for k in range(len(plain)):
        m00, m01, m02 = plain[k, 0, 0], plain[k, 0, 1], plain[k, 0, 2]
        m10, m11, m12 = plain[k, 1, 0], plain[k, 1, 1], plain[k, 1, 2]
        m20, m21, m22 = plain[k, 2, 0], plain[k, 2, 1], plain[k, 2, 2]
        source, to = 3 * max(k - 1, 0), 3 * k
        for i in range(m):
            x, y, z = rows[source, i], rows[source + 1, i], rows[source + 2, i]
            if k > 0:
                s, c = trig[2 * k - 2, i], trig[2 * k - 1, i]
                x, y = c * x + s * y, c * y - s * x
            rows[to, i] = m00 * x + m10 * y + m20 * z
            rows[to + 1, i] = m01 * x + m11 * y + m21 * z
            rows[to + 2, i] = m02 * x + m12 * y + m22 * z


@jit
def _levers(plain: F64, trig: F64, gravity: F64, lever: F64, m: int) -> None:
    """Mass moments (scaled to Nm under unit gravity) of all links beyond a frame, in that frame."""
    last = 3 * (len(plain) - 1)
    for i in range(m):
        lever[last, i] = lever[last + 1, i] = lever[last + 2, i] = 0.0
    for k in range(len(plain) - 1, 0, -1):
        own_x, own_y, own_z, carried = gravity[k]
        m00, m01, m02, m03 = plain[k, 0, 0], plain[k, 0, 1], plain[k, 0, 2], plain[k, 0, 3]
        m10, m11, m12, m13 = plain[k, 1, 0], plain[k, 1, 1], plain[k, 1, 2], plain[k, 1, 3]
        m20, m21, m22, m23 = plain[k, 2, 0], plain[k, 2, 1], plain[k, 2, 2], plain[k, 2, 3]
        m03, m13, m23 = carried * m03, carried * m13, carried * m23
        a = 3 * k
        for i in range(m):
            x, y, z = lever[a, i] + own_x, lever[a + 1, i] + own_y, lever[a + 2, i] + own_z
            s, c = trig[2 * k - 2, i], trig[2 * k - 1, i]
            along = m00 * x + m01 * y + m02 * z + m03
            across = m10 * x + m11 * y + m12 * z + m13
            lever[a - 3, i] = c * along - s * across
            lever[a - 2, i] = s * along + c * across
            lever[a - 1, i] = m20 * x + m21 * y + m22 * z + m23

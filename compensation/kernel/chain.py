"""The kernel's inner loops over a block: from the tip to the world, joint after joint.

Rows of a work array are addressed by constants or by one offset plus constants, so that LLVM can
prove that they do not overlap.
"""

from __future__ import annotations

import math

import numpy as np

from armd.arrays import F64
from armd.compensation.kernel.memory import Folded, Program, Work
from armd.compiled.jit import inlined, jit

# π/2 in two parts. j·_HALF_PI is exact inside a fused multiply-add; without one it is rounded, as
# the angle itself was.
_HALF_PI, _HALF_PI_REST = math.pi / 2, 6.123233995736766e-17
# 1.5 · 2⁵²: adding it to a number below 2⁵¹ rounds that to an integer, whose last bits the sum has.
_TO_INTEGER = 6755399441055744.0


@inlined
def compute_sincos(angle: F64, first: int, rows: int, order: float, out: F64, to: int) -> None:
    """Compute sines and cosines of order · angle, error below 2e-16, into *out* from row *to* on.

    Reduction to ±π/4 by multiples of π/2, minimax polynomials (of degree 13 and 12, by Remez'
    exchange: errors 2e-18 and 8e-17), quadrant by the last two bits of the multiple. Sine and
    cosine rows alternate.
    """
    for k in range(rows):
        _sincos_row(angle, first + k, order, out, to + 2 * k)


@inlined
def _sincos_row(angle: F64, row: int, order: float, out: F64, to: int) -> None:
    for i in range(angle.shape[1]):
        x = order * angle[row, i]
        rounded = x * (2 / math.pi) + _TO_INTEGER
        j = rounded - _TO_INTEGER
        r = (x - j * _HALF_PI) - j * _HALF_PI_REST
        z = r * r
        s = 1.588858598765573e-10 * z - 2.505060023954864e-08
        s = s * z + 2.755731254478094e-06
        s = s * z - 1.984126982593414e-04
        s = s * z + 8.333333333316482e-03
        s = s * z - 1.66666666666666e-01
        s = r + r * z * s
        c = 2.064773805264132e-09 * z - 2.755556713401747e-07
        c = c * z + 2.480158097168961e-05
        c = c * z - 1.388888887827438e-03
        c = c * z + 4.166666666660226e-02
        c = 1.0 + z * (c * z - 0.5)
        quadrant = np.float64(rounded).view(np.int64)
        is_odd = (quadrant & 1) != 0
        out[to, i] = _flip_in_second_half(c if is_odd else s, quadrant)
        out[to + 1, i] = _flip_in_second_half(s if is_odd else c, quadrant + 1)


@inlined
def _flip_in_second_half(value: float, quadrant: np.int64) -> np.float64:
    """Return *value* with its sign flipped if the quadrant's last two bits are 2 or 3."""
    bits = np.float64(value).view(np.int64) ^ ((quadrant & 2) << 62)
    return np.int64(bits).view(np.float64)


@inlined
def start_vectors(vectors: F64, v: int, tip: F64) -> None:
    """Fill rows v … v + 2 with the tip's offset; for v = 3, six rows with the x and y axes.

    All are in the last frame.
    """
    if v == 3:
        for row in range(3, 9):
            value = 1.0 if row in (3, 7) else 0.0
            for i in range(vectors.shape[1]):
                vectors[row, i] = value
        return
    for axis in range(3):
        value = tip[axis]
        for i in range(vectors.shape[1]):
            vectors[v + axis, i] = value


@inlined
def apply_fixed(matrices: F64, high: int, low: int, trig: F64, vectors: F64, v: int) -> None:
    """Transform rows v … v + 2 from link *high* through the joints *high* … *low*.

    The result is in link *low* − 1; *low* = 0 also transforms through the base to the world. Rows
    3–8 are axes, which have no position.
    """
    place = 0.0 if 3 <= v < 9 else 1.0
    for k in range(high, max(low, 1) - 1, -1):
        _fixed_joint(matrices, k, place, trig, vectors, v)
    if low == 0 and _displaced(matrices):
        _fixed_base(matrices, place, vectors, v)


@inlined
def _fixed_joint(matrices: F64, k: int, place: float, trig: F64, vectors: F64, v: int) -> None:
    m00, m01, m02, m03 = matrices[k, 0, 0], matrices[k, 0, 1], matrices[k, 0, 2], matrices[k, 0, 3]
    m10, m11, m12, m13 = matrices[k, 1, 0], matrices[k, 1, 1], matrices[k, 1, 2], matrices[k, 1, 3]
    m20, m21, m22, m23 = matrices[k, 2, 0], matrices[k, 2, 1], matrices[k, 2, 2], matrices[k, 2, 3]
    m03, m13, m23 = m03 * place, m13 * place, m23 * place
    sine = 2 * (k - 1)
    for i in range(vectors.shape[1]):
        x, y, z = vectors[v, i], vectors[v + 1, i], vectors[v + 2, i]
        s, c = trig[sine, i], trig[sine + 1, i]
        along = m03 + m00 * x + m01 * y + m02 * z
        across = m13 + m10 * x + m11 * y + m12 * z
        vectors[v, i] = c * along - s * across
        vectors[v + 1, i] = s * along + c * across
        vectors[v + 2, i] = m23 + m20 * x + m21 * y + m22 * z


@jit
def _displaced(matrices: F64) -> bool:
    """Return whether the base is displaced from its nominal pose, which is rare."""
    for row in range(3):
        for column in range(4):
            if matrices[0, row, column] != (1.0 if row == column else 0.0):
                return True
    return False


@inlined
def _fixed_base(matrices: F64, place: float, vectors: F64, v: int) -> None:
    m00, m01, m02, m03 = matrices[0, 0, 0], matrices[0, 0, 1], matrices[0, 0, 2], matrices[0, 0, 3]
    m10, m11, m12, m13 = matrices[0, 1, 0], matrices[0, 1, 1], matrices[0, 1, 2], matrices[0, 1, 3]
    m20, m21, m22, m23 = matrices[0, 2, 0], matrices[0, 2, 1], matrices[0, 2, 2], matrices[0, 2, 3]
    m03, m13, m23 = m03 * place, m13 * place, m23 * place
    for i in range(vectors.shape[1]):
        x, y, z = vectors[v, i], vectors[v + 1, i], vectors[v + 2, i]
        vectors[v, i] = m03 + m00 * x + m01 * y + m02 * z
        vectors[v + 1, i] = m13 + m10 * x + m11 * y + m12 * z
        vectors[v + 2, i] = m23 + m20 * x + m21 * y + m22 * z


@jit
def compute_posed_rows(
    group: int, offset: int, rows: int, folded: Folded, program: Program, work: Work
) -> None:
    """Compute a group's parameters from *offset* on for each sample: rows of `work.posed`."""
    posed, product = work.posed, work.product
    for row in range(rows):
        value = folded.parameters[offset + row]
        for i in range(posed.shape[1]):
            posed[row, i] = value
    for t in range(program.first[group], program.first[group + 1]):
        coefficient = folded.coefficients[t]
        for i in range(posed.shape[1]):
            product[0, i] = coefficient
        for j in range(program.factor_first[t], program.factor_first[t + 1]):
            f = program.term_factors[j]
            for i in range(posed.shape[1]):
                product[0, i] *= work.factors[f, i]
        row = program.parameter[t] - offset
        for i in range(posed.shape[1]):
            posed[row, i] += product[0, i]


@jit
def apply_posed_joint(k: int, folded: Folded, program: Program, work: Work, turned: int) -> None:
    """Apply joint k (from 0), whose five parameters differ from sample to sample.

    It does the same as `_fixed_joint`, for *turned* vectors.
    """
    compute_posed_rows(k, 5 * k, 5, folded, program, work)
    posed, angle, vectors = work.posed, work.angle, work.vectors
    for i in range(posed.shape[1]):
        posed[0, i] += angle[k, i]
    compute_sincos(posed, 0, 1, 1.0, posed, 6)
    compute_sincos(posed, 3, 2, 1.0, posed, 8)
    for v in range(0, 3 * turned, 3):
        shift = 1.0 if v == 0 else 0.0
        for i in range(posed.shape[1]):
            x, y, z = vectors[v, i], vectors[v + 1, i], vectors[v + 2, i]
            x, z = posed[11, i] * x + posed[10, i] * z, posed[11, i] * z - posed[10, i] * x
            y, z = posed[9, i] * y - posed[8, i] * z, posed[8, i] * y + posed[9, i] * z
            x += shift * posed[2, i]
            vectors[v, i] = posed[7, i] * x - posed[6, i] * y
            vectors[v + 1, i] = posed[6, i] * x + posed[7, i] * y
            vectors[v + 2, i] = z + shift * posed[1, i]


@jit
def apply_posed_base(
    n_joints: int, folded: Folded, program: Program, work: Work, turned: int
) -> None:
    """Apply the base's displacement, which differs from sample to sample."""
    compute_posed_rows(n_joints + 1, 5 * n_joints + 3, 6, folded, program, work)
    posed, vectors = work.posed, work.vectors
    compute_sincos(posed, 3, 3, 1.0, posed, 6)
    for v in range(0, 3 * turned, 3):
        shift = 1.0 if v == 0 else 0.0
        for i in range(posed.shape[1]):
            x, y, z = vectors[v, i], vectors[v + 1, i], vectors[v + 2, i]
            y, z = posed[7, i] * y - posed[6, i] * z, posed[6, i] * y + posed[7, i] * z
            x, z = posed[9, i] * x + posed[8, i] * z, posed[9, i] * z - posed[8, i] * x
            vectors[v, i] = posed[11, i] * x - posed[10, i] * y + shift * posed[0, i]
            vectors[v + 1, i] = posed[10, i] * x + posed[11, i] * y + shift * posed[1, i]
            vectors[v + 2, i] = z + shift * posed[2, i]


@jit
def compute_quaternion(vectors: F64, i: int) -> tuple[float, float, float, float]:
    """Return x, y, z, w ≥ 0 of the frame whose x and y axes are in rows 3–8 (Shepperd's choice)."""
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

"""Derivatives of the tip by all parameters, for a block of samples that differ in parameters.

The mathematics is that of `kinematics.fill_jacobian`, evaluated as in `chain`: every inner loop
runs over the samples of a block. All numbers are in one flat array, in rows of a constant width.
Then LLVM can prove for so many rows that they do not overlap, and makes vector instructions (a
ninth of the time).

Each joint has `ROWS` rows, which hold three axes or one number each:

    0 by θ   3 by d, and the z axis before the joint   6 by a   9 by α   12 by β
    15 x axis and 18 y axis before the joint   21 from the joint's origin to the tip
    24 sine and cosine of θ+q   26 of α   28 of β   30 d   31 a   32 θ+q

One more such group holds the last frame, with the tip's offset in 24, 25, 26. After it come the
derivatives by the base's displacement, and sines and cosines of its angles.
"""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.kernel.chain import compute_sincos
from armd.compensation.kernel.memory import BLOCK as W
from armd.compiled.jit import inlined, jit

ROWS = 33
#: Derivatives by x, y, z, rx, ry, rz of the base; three sines and cosines.
BASE_ROWS = 24


@jit
def make_work(n_joints: int, more_rows: int) -> F64:
    """Make a work array (rows, W) for the derivatives of a block, followed by *more_rows*."""
    return np.zeros((ROWS * (n_joints + 1) + BASE_ROWS + more_rows, W))


@jit
def find_row(parameter: int, n_joints: int) -> int:
    """Return the first of the three rows that hold the derivative by a parameter."""
    offset = parameter - 5 * n_joints
    if offset < 0:
        return ROWS * (parameter // 5) + 3 * (parameter % 5)
    last = ROWS * n_joints
    if offset < 3:
        return last + (3 if offset == 2 else 15 + 3 * offset)
    return last + ROWS + 3 * (offset - 3)


@jit
def take_parameters(parameters: F64, n_joints: int, work: F64) -> None:
    """Set the parameters (P, W) of the samples of a block."""
    for k in range(n_joints):
        o = ROWS * k
        compute_sincos(parameters, 5 * k + 3, 2, 1.0, work, o + 26)
        for i in range(W):
            work[o + 30, i] = parameters[5 * k + 1, i]
            work[o + 31, i] = parameters[5 * k + 2, i]
    last, tip = ROWS * n_joints, 5 * n_joints
    for j in range(3):
        for i in range(W):
            work[last + 24 + j, i] = parameters[tip + j, i]
    base = last + ROWS
    compute_sincos(parameters, tip + 6, 3, 1.0, work, base + 18)
    for row in range(9):
        value = 1.0 if row in (0, 4, 8) else 0.0
        for i in range(W):
            work[base + row, i] = value
    for i in range(W):
        sx, cx = work[base + 18, i], work[base + 19, i]
        sy, cy = work[base + 20, i], work[base + 21, i]
        sz, cz = work[base + 22, i], work[base + 23, i]
        work[15, i], work[16, i], work[17, i] = cz * cy, sz * cy, -sy
        work[18, i] = cz * sy * sx - sz * cx
        work[19, i] = sz * sy * sx + cz * cx
        work[20, i] = cy * sx
        work[3, i] = cz * sy * cx + sz * sx
        work[4, i] = sz * sy * cx - cz * sx
        work[5, i] = cy * cx


@jit
def compute_block_jacobian(q: F64, start: int, m: int, parameters: F64, work: F64) -> None:
    """Compute derivatives (3, W) of samples *start* … *start* + m − 1 in rows of `find_row`."""
    n_joints = q.shape[1]
    flat = work.reshape(work.size)
    for k in range(n_joints):
        o = ROWS * k
        for i in range(m):
            work[o + 32, i] = q[start + i, k] + parameters[5 * k, i]
        compute_sincos(work, o + 32, 1, 1.0, work, o + 24)
        _step(flat[o * W : (o + 2 * ROWS) * W])
    last = ROWS * n_joints
    _to_tip(flat[last * W : (last + ROWS) * W])
    for k in range(n_joints - 1, -1, -1):
        _derive(flat[ROWS * k * W : ROWS * (k + 2) * W])
    base = last + ROWS
    for i in range(m):
        x, y, z = work[21, i], work[22, i], work[23, i]
        work[base + 9, i] = work[16, i] * z - work[17, i] * y
        work[base + 10, i] = work[17, i] * x - work[15, i] * z
        work[base + 11, i] = work[15, i] * y - work[16, i] * x
        sz, cz = work[base + 22, i], work[base + 23, i]
        work[base + 12, i] = cz * z
        work[base + 13, i] = sz * z
        work[base + 14, i] = -sz * y - cz * x
        work[base + 15, i], work[base + 16, i], work[base + 17, i] = -y, x, 0.0


@inlined
def _step(work: F64) -> None:
    """Compute the frame behind a joint from the frame before it."""
    for i in range(W):
        st, ct, sa, ca = work[24 * W + i], work[25 * W + i], work[26 * W + i], work[27 * W + i]
        sb, cb = work[28 * W + i], work[29 * W + i]
        for axis in range(3):  # LLVM unrolls this loop
            r = axis * W + i
            x, y, z = work[15 * W + r], work[18 * W + r], work[3 * W + r]
            x, y = ct * x + st * y, ct * y - st * x  # Rz
            y, z = ca * y + sa * z, ca * z - sa * y  # Rx
            work[6 * W + r], work[12 * W + r] = x, y
            work[(ROWS + 15) * W + r] = cb * x - sb * z  # Ry
            work[(ROWS + 18) * W + r] = y
            work[(ROWS + 3) * W + r] = sb * x + cb * z


@inlined
def _to_tip(work: F64) -> None:
    """Compute the vector from the last frame's origin to the tip."""
    for i in range(W):
        x, y, z = work[24 * W + i], work[25 * W + i], work[26 * W + i]
        work[21 * W + i] = work[15 * W + i] * x + work[18 * W + i] * y + work[3 * W + i] * z
        work[22 * W + i] = work[16 * W + i] * x + work[19 * W + i] * y + work[4 * W + i] * z
        work[23 * W + i] = work[17 * W + i] * x + work[20 * W + i] * y + work[5 * W + i] * z


@inlined
def _derive(work: F64) -> None:
    """Compute a joint's derivatives, given the tip as seen from the frame behind it."""
    for i in range(W):
        x, y, z = (
            work[(ROWS + 21) * W + i],
            work[(ROWS + 22) * W + i],
            work[(ROWS + 23) * W + i],
        )
        u, v, w = work[12 * W + i], work[13 * W + i], work[14 * W + i]
        work[12 * W + i], work[13 * W + i] = v * z - w * y, w * x - u * z
        work[14 * W + i] = u * y - v * x
        u, v, w = work[6 * W + i], work[7 * W + i], work[8 * W + i]
        work[9 * W + i], work[10 * W + i] = v * z - w * y, w * x - u * z
        work[11 * W + i] = u * y - v * x
        d, a = work[30 * W + i], work[31 * W + i]
        x, y, z = x + a * u, y + a * v, z + a * w
        u, v, w = work[3 * W + i], work[4 * W + i], work[5 * W + i]
        x, y, z = x + d * u, y + d * v, z + d * w
        work[21 * W + i], work[22 * W + i], work[23 * W + i] = x, y, z
        work[i], work[W + i], work[2 * W + i] = v * z - w * y, w * x - u * z, u * y - v * x

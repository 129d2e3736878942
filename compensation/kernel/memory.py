"""The arrays of a model in the kernel: constants, folded terms, pose terms, scratch."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armd.arrays import F64, I64
from armd.compiled.jit import jit

#: Samples of a batch that are processed together.
BLOCK = 64


class Amounts(NamedTuple):
    """The effect of a unit of a term's slow factors."""

    slow_parameter: I64  # (L,) index of the parameter a slow term changes
    slow: F64  # (L,) coefficients of the slow terms
    pose: F64  # (T,) coefficients of the pose terms, in the order of the program


class Folded(NamedTuple):
    """Everything that changes with temperature or time but not with the pose."""

    constant: F64  # (N+1, 3, 4) base, joint 1 … N by the constants alone
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
    needs: I64  # (3,) flags: gravity levers, gravity in links, approach in links
    curves: F64  # (C, 4) cubic pieces, lowest power first; a curve begins at its `detail`
    # (N+1, 4) row 0: unit gravity in the base frame; row k: mass moment of link k (3) and mass
    # carried from it on, both scaled so that moments are in Nm
    gravity: F64


class Work(NamedTuple):
    """Scratch arrays of one model, as wide as the number of samples processed together (B)."""

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


class FlatModel(NamedTuple):
    """A model in the form that one compiled call takes.

    Each array that crosses from Python costs 0.05 µs and each in a tuple 0.15 µs. So three flat
    arrays cross, and `open_flat` makes views of them.
    """

    sizes: I64  # N, T, F, C and length of term_factors; then the integers of the program
    numbers: F64  # Folded, then the floats of the program
    work: F64  # (rows, B)

    def for_batches(self) -> FlatModel:
        """Return a copy that processes `BLOCK` samples together."""
        return FlatModel(self.sizes, self.numbers.copy(), np.zeros((len(self.work), BLOCK)))


@jit
def open_flat(flat: FlatModel) -> tuple[Folded, Program, Work]:
    """Return views of the flat arrays, in the order in which the tuples are declared."""
    n, t, f, c, listed = flat.sizes[:5]
    i = flat.sizes[5:]
    parameter, i = i[:t], i[t:]
    first, i = i[: n + 3], i[n + 3 :]
    factor_first, i = i[: t + 1], i[t + 1 :]
    term_factors, i = i[:listed], i[listed:]
    factors, i = i[: 3 * f].reshape(f, 3), i[3 * f :]
    curve_pieces, needs = i[:f], i[f:]
    x, matrix, p = flat.numbers, 12 * (n + 1), 5 * n + 9
    constant, x = x[:matrix].reshape(n + 1, 3, 4), x[matrix:]
    matrices, x = x[:matrix].reshape(n + 1, 3, 4), x[matrix:]
    parameters, x = x[:p], x[p:]
    constants, x = x[:p], x[p:]
    coefficients, x = x[:t], x[t:]
    curves, gravity = x[: 4 * c].reshape(c, 4), x[4 * c :].reshape(n + 1, 4)
    w, frames = flat.work, 3 * n + 3
    angle, trig, w = w[:n], w[n : 3 * n], w[3 * n :]
    vectors, posed, product, w = w[:12], w[12:24], w[24:25], w[25:]
    values, w = w[:f], w[f:]
    down, lever, toward = w[:frames], w[frames : 2 * frames], w[2 * frames :]
    return (
        Folded(constant, matrices, parameters, constants, coefficients),
        Program(
            parameter, first, factor_first, term_factors, factors, curve_pieces, needs,
            curves, gravity,
        ),
        Work(angle, trig, vectors, posed, product, values, down, lever, toward),
    )  # fmt: skip


@jit
def fold(values: F64, amounts: Amounts, flat: FlatModel) -> None:
    """Fold the slow factors' values (L+T,), slow terms first, into a model."""
    folded, _, _ = open_flat(flat)
    slow = len(amounts.slow)
    parameters = folded.parameters
    for p in range(len(parameters)):  # a slice would compile two seconds of shape messages
        parameters[p] = folded.constants[p]
    for t in range(slow):
        parameters[amounts.slow_parameter[t]] += amounts.slow[t] * values[t]
    for t in range(len(amounts.pose)):
        folded.coefficients[t] = amounts.pose[t] * values[slow + t]
    set_matrices(folded.constants, folded.constant)
    set_matrices(parameters, folded.matrices)


@jit
def set_matrices(parameters: F64, matrices: F64) -> None:
    """Set matrices (N+1, 3, 4) from parameters (P,): the base's, then the joints' without Rz(q)."""
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

"""The pose factors of terms, evaluated for a block of samples."""

from __future__ import annotations

import math

import numpy as np

from armd.arrays import F64
from armd.compensation.kernel.chain import compute_sincos
from armd.compensation.kernel.memory import Program, Work
from armd.compiled.jit import jit

#: Kinds of pose factors; a row in `Program.factors` is (kind, joint or link from 0, detail).
KINDS = (
    "sin",
    "cos",
    "angle",
    "curve",
    "torque",
    "direction",
    "moment",
    "side",
    "rate",
    "approach",
    "approach_tip",
)
SIN, COS, ANGLE, CURVE, TORQUE, DIRECTION, MOMENT, SIDE, RATE, APPROACH, APPROACH_TIP = range(11)


@jit
def evaluate_factors(
    rate: F64, approach: F64, start: int, constant: F64, program: Program, work: Work, m: int
) -> None:
    """Evaluate every distinct pose factor into one row of `work.factors` each."""
    factors, trig = work.factors, work.trig
    down, lever, width = work.down, work.lever, trig.shape[1]
    if program.needs[1]:
        for axis in range(3):
            for i in range(width):
                down[axis, i] = program.gravity[0, axis]
        _into_links(constant, trig, down)
    if program.needs[0]:
        _levers(constant, trig, program.gravity, lever)
    if program.needs[2]:
        for i in range(m):
            for axis in range(3):
                toward = approach[start + i, axis]
                work.toward[axis, i] = 0.0 if np.isnan(toward) else toward
        _into_links(constant, trig, work.toward)
    for f in range(len(program.factors)):
        kind, k, detail = program.factors[f, 0], program.factors[f, 1], program.factors[f, 2]
        if kind in (SIN, COS):
            which = 0 if kind == SIN else 1
            if detail == 1:
                for i in range(width):
                    factors[f, i] = trig[2 * k + which, i]
            else:
                compute_sincos(work.angle, k, 1, float(detail), work.posed, 0)
                for i in range(width):
                    factors[f, i] = work.posed[which, i]
        elif kind == ANGLE:
            for i in range(width):
                factors[f, i] = work.angle[k, i] ** detail
        elif kind == CURVE:
            _curve(work.angle, k, program.curves, detail, program.curve_pieces[f], factors, f)
        elif kind == TORQUE:
            a = 3 * k  # the frame before the joint, whose z axis is the joint's axis
            for i in range(width):
                factors[f, i] = lever[a, i] * down[a + 1, i] - lever[a + 1, i] * down[a, i]
        elif kind == MOMENT:
            a, b = 3 * (k + 1) + (detail + 1) % 3, 3 * (k + 1) + (detail + 2) % 3
            for i in range(width):
                factors[f, i] = lever[a, i] * down[b, i] - lever[b, i] * down[a, i]
        elif kind == DIRECTION:
            for i in range(width):
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
            for i in range(width):
                factors[f, i] = work.toward[last + detail, i]


@jit
def _curve(angle: F64, k: int, curves: F64, first: int, pieces: int, factors: F64, f: int) -> None:
    """Evaluate a periodic piecewise cubic; pieces are counted from angle 0, their argument is in
    rad.
    """
    width = 2 * math.pi / pieces
    for i in range(angle.shape[1]):
        turns = angle[k, i] / (2 * math.pi)
        place = (turns - np.floor(turns)) * pieces
        piece = min(int(place), pieces - 1)
        x = (place - piece) * width
        c = first + piece
        factors[f, i] = curves[c, 0] + x * (curves[c, 1] + x * (curves[c, 2] + x * curves[c, 3]))


@jit
def _into_links(constant: F64, trig: F64, rows: F64) -> None:
    """Transform the vectors of rows 0–2 from the world to every frame: rows 3k … 3k + 2.

    Rows 0–2 are themselves transformed to the frame before joint 1.
    """
    for k in range(len(constant)):
        m00, m01, m02 = constant[k, 0, 0], constant[k, 0, 1], constant[k, 0, 2]
        m10, m11, m12 = constant[k, 1, 0], constant[k, 1, 1], constant[k, 1, 2]
        m20, m21, m22 = constant[k, 2, 0], constant[k, 2, 1], constant[k, 2, 2]
        source, to = 3 * max(k - 1, 0), 3 * k
        for i in range(rows.shape[1]):
            x, y, z = rows[source, i], rows[source + 1, i], rows[source + 2, i]
            if k > 0:
                s, c = trig[2 * k - 2, i], trig[2 * k - 1, i]
                x, y = c * x + s * y, c * y - s * x
            rows[to, i] = m00 * x + m10 * y + m20 * z
            rows[to + 1, i] = m01 * x + m11 * y + m21 * z
            rows[to + 2, i] = m02 * x + m12 * y + m22 * z


@jit
def _levers(constant: F64, trig: F64, gravity: F64, lever: F64) -> None:
    """Compute mass moments (Nm under unit gravity) of all links beyond a frame, in that frame."""
    last = 3 * (len(constant) - 1)
    for i in range(lever.shape[1]):
        lever[last, i] = lever[last + 1, i] = lever[last + 2, i] = 0.0
    for k in range(len(constant) - 1, 0, -1):
        own_x, own_y, own_z, carried = gravity[k]
        m00, m01, m02, m03 = (
            constant[k, 0, 0],
            constant[k, 0, 1],
            constant[k, 0, 2],
            constant[k, 0, 3],
        )
        m10, m11, m12, m13 = (
            constant[k, 1, 0],
            constant[k, 1, 1],
            constant[k, 1, 2],
            constant[k, 1, 3],
        )
        m20, m21, m22, m23 = (
            constant[k, 2, 0],
            constant[k, 2, 1],
            constant[k, 2, 2],
            constant[k, 2, 3],
        )
        m03, m13, m23 = carried * m03, carried * m13, carried * m23
        a = 3 * k
        for i in range(lever.shape[1]):
            x, y, z = lever[a, i] + own_x, lever[a + 1, i] + own_y, lever[a + 2, i] + own_z
            s, c = trig[2 * k - 2, i], trig[2 * k - 1, i]
            along = m00 * x + m01 * y + m02 * z + m03
            across = m10 * x + m11 * y + m12 * z + m13
            lever[a - 3, i] = c * along - s * across
            lever[a - 2, i] = s * along + c * across
            lever[a - 1, i] = m20 * x + m21 * y + m22 * z + m23

"""The kernel: corrects angles to points, many samples at once or one.

`fold` combines beforehand what depends on temperature and time alone into one constant 3 × 4 matrix
per joint, A = Rz(q)·[Rz(θ0)·Tz(d)·Tx(a)·Rx(α)·Ry(β)]. So a sample costs only the sines and cosines
of its joints, and the joints that have pose-dependent terms.

Samples are processed in blocks, one row of a small array per quantity. Every inner loop runs over
the samples of the block without a call or a branch, so that LLVM vectorises it. Each such loop is a
function of its own, because LLVM does not vectorise nested loops. The width of the scratch array
sets the width of a block: 64 for a batch, 1 for live samples. So the result does not depend on how
the live samples were grouped in calls.

`memory` holds a model's arrays, `chain` the inner loops, `pose_factors` the pose-dependent
functions.
"""

from __future__ import annotations

import math

from armd.arrays import F64, I64
from armd.compensation.kernel.chain import (
    apply_fixed,
    apply_posed_base,
    apply_posed_joint,
    compute_posed_rows,
    compute_sincos,
    start_vectors,
)
from armd.compensation.kernel.memory import (
    Amounts,
    FlatModel,
    Folded,
    Program,
    Work,
    fold,
    open_flat,
)
from armd.compensation.kernel.pose_factors import evaluate_factors
from armd.compiled.jit import inlined, jit, unlocked


@jit
def compute_uncorrected(q: F64, flat: FlatModel, position: F64) -> None:
    """Compute tip positions (n, 3) mm by the constants alone."""
    folded, _, work = open_flat(flat)
    angle, trig, vectors = work.angle, work.trig, work.vectors
    tip = folded.constants[5 * len(angle) :]
    for start in range(0, len(q), angle.shape[1]):
        m = min(angle.shape[1], len(q) - start)
        take_angles(q, start, m, angle, trig)
        to_world(folded.constant, tip, trig, vectors, 0)
        for i in range(m):
            for axis in range(3):
                position[start + i, axis] = vectors[axis, i]


@jit
def correct(
    q: F64, rate: F64, approach: F64, flat: FlatModel, position: F64, correction: F64
) -> None:
    """Compute tip positions (n, 3) mm and, unless its length is 0, corrections (n, 3) mm."""
    folded, program, work = open_flat(flat)
    angle, trig, vectors = work.angle, work.trig, work.vectors
    tip, plain_tip = folded.parameters[5 * len(angle) :], folded.constants[5 * len(angle) :]
    for start in range(0, len(q), angle.shape[1]):
        m = min(angle.shape[1], len(q) - start)
        take_angles(q, start, m, angle, trig)
        if len(program.parameter):
            to_world_posed(rate, approach, start, m, folded, program, work, 1)
        else:
            to_world(folded.matrices, tip, trig, vectors, 0)
        for i in range(m):
            for axis in range(3):
                position[start + i, axis] = vectors[axis, i]
        if len(correction):
            to_world(folded.constant, plain_tip, trig, vectors, 9)
            for i in range(m):
                for axis in range(3):
                    correction[start + i, axis] = vectors[axis, i] - vectors[9 + axis, i]


@unlocked
def correct_runs(
    values: F64, amounts: Amounts, q: F64, rate: F64, approach: F64, flat: FlatModel,
    position: F64, correction: F64,
) -> None:  # fmt: skip
    """Correct n samples, row i under its own *values* (n, L+T); equal neighbours share a fold."""
    first = 0
    while first < len(values):
        end = first + 1
        while end < len(values) and are_alike(values, end, first):
            end += 1
        fold(values[first], amounts, flat)
        correct(
            q[first:end], rate[first:end], approach[first:end], flat,
            position[first:end], correction[first:end],
        )  # fmt: skip
        first = end


@jit
def are_alike(rows: F64, i: int, j: int) -> bool:
    """Return whether two rows of *rows* (n, K) are equal, with NaN in the same columns."""
    first, second = rows[i], rows[j]
    differing = 0
    for k in range(len(first)):  # without a branch: LLVM takes eight columns at once
        a, b = first[k], second[k]
        differing += (a != b) & ~(math.isnan(a) & math.isnan(b))
    return differing == 0


@inlined
def take_angles(q: F64, start: int, m: int, angle: F64, trig: F64) -> None:
    """Load the angles of m samples, and compute their sines and cosines."""
    n_joints = q.shape[1]
    threes = n_joints - n_joints % 3
    for k in range(0, threes, 3):
        _take_three(q, start, m, k, angle)
    for k in range(threes, n_joints):
        for i in range(m):
            angle[k, i] = q[start + i, k]
    compute_sincos(angle, 0, n_joints, 1.0, trig, 0)


@inlined
def _take_three(q: F64, start: int, m: int, k: int, angle: F64) -> None:
    """Load the angles of three joints from *k* on: together, LLVM vectorises the loads."""
    for i in range(m):
        angle[k, i] = q[start + i, k]
        angle[k + 1, i] = q[start + i, k + 1]
        angle[k + 2, i] = q[start + i, k + 2]


@inlined
def to_world(matrices: F64, tip: F64, trig: F64, vectors: F64, v: int) -> None:
    """Transform rows v … v + 2 of *vectors* from the last frame to the world.

    They are the tip (v = 0 or 9), or the x and y axes of the last frame (v = 3 takes both).
    """
    start_vectors(vectors, v, tip)
    apply_fixed(matrices, len(matrices) - 1, 0, trig, vectors, v)
    if v == 3:
        apply_fixed(matrices, len(matrices) - 1, 0, trig, vectors, 6)


@jit
def to_world_posed(
    rate: F64, approach: F64, start: int, m: int, folded: Folded, program: Program, work: Work,
    turned: int,
) -> None:  # fmt: skip
    """Transform to the world with pose terms: the tip, and if *turned* is 3 the two axes."""
    vectors, n_joints, first = work.vectors, len(work.angle), program.first
    start_vectors(vectors, 0, folded.parameters[5 * n_joints :])
    start_vectors(vectors, 3, folded.parameters)
    evaluate_factors(rate, approach, start, folded.constant, program, work, m)
    if first[n_joints] < first[n_joints + 1]:
        compute_posed_rows(n_joints, 5 * n_joints, 3, folded, program, work)
        for axis in range(3):
            for i in range(vectors.shape[1]):
                vectors[axis, i] = work.posed[axis, i]
    k = n_joints
    while k >= 0:
        if _has_pose_terms(k, first):
            if k > 0:
                apply_posed_joint(k - 1, folded, program, work, turned)
            else:
                apply_posed_base(n_joints, folded, program, work, turned)
            k -= 1
            continue
        low = k
        while low > 0 and not _has_pose_terms(low - 1, first):
            low -= 1
        for v in range(0, 3 * turned, 3):
            apply_fixed(folded.matrices, k, low, work.trig, vectors, v)
        k = low - 1


@jit
def _has_pose_terms(k: int, first: I64) -> bool:
    """Return whether joint k (from 1), or the base for k = 0, differs from sample to sample."""
    group = k - 1 if k > 0 else len(first) - 2
    return bool(first[group] < first[group + 1])

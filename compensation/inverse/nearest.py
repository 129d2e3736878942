"""Find the angles nearest to given ones that meet constraints: Newton steps, many rows at once.

The step of a row solves J·(q − q₀) = J·(q' − q₀) − c for the least |q − q₀|. So its fixed point
meets c = 0 and departs from q₀ along the rows of J alone: the least change. J is a central
difference, so it contains the pose's part in every term.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armd.arrays import F64, I64

#: Constraints (m, C), without unit and of the order of a radian, at angles (m, N) of these rows.
Constraints = Callable[[F64, I64], F64]

#: rad: the step of a central difference, and the largest step of an iteration.
DIFFERENCE_RAD, LONGEST_RAD = 1e-4, 0.3
#: A row has converged if its step is smaller; so are constraints that are met.
ARRIVED = 1e-11
MET, NEARLY_MET = 1e-11, 1e-7
STEPS, DAMPED_STEPS = 60, 40
#: rad: starts near the given one, for a posture from which no first step makes progress.
BESIDE_RAD = (0.0, 0.05, 0.2)


def solve_nearest(constraints: Constraints, q0: F64) -> tuple[F64, F64]:
    """Solve for angles (n, N) rad near *q0* (n, N); also return the constraints' norm (n,) there.

    Where the constraints cannot be met, the angles are those that meet them best nearby.
    """
    q, miss = _least_change(constraints, q0, q0, np.arange(len(q0)))
    stuck = np.flatnonzero(~(miss <= MET))
    for number, offset_rad in enumerate(BESIDE_RAD):
        if not len(stuck):
            break
        start = q0[stuck] + offset_rad * _pattern(q0.shape[1], number)
        better, its_miss = _damped(constraints, start, stuck)
        met = np.flatnonzero(its_miss <= NEARLY_MET)
        nearest, least_miss = _least_change(constraints, better[met], q0[stuck[met]], stuck[met])
        nearer = least_miss <= NEARLY_MET
        better[met[nearer]], its_miss[met[nearer]] = nearest[nearer], least_miss[nearer]
        gained = ~(its_miss >= miss[stuck])
        q[stuck[gained]], miss[stuck[gained]] = better[gained], its_miss[gained]
        stuck = stuck[~(miss[stuck] <= MET)]
    return q, miss


def compute_derivatives(constraints: Constraints, q: F64, rows: I64) -> F64:
    """Compute the derivatives (m, C, N) of the constraints by the angles."""
    m, n_joints = q.shape
    steps = DIFFERENCE_RAD * np.vstack([np.eye(n_joints), -np.eye(n_joints)])
    moved = (q + steps[:, None, :]).reshape(-1, n_joints)  # one call: calls cost most
    c = constraints(moved, np.tile(rows, 2 * n_joints)).reshape(2, n_joints, m, -1)
    columns: F64 = (c[0] - c[1]).transpose(1, 2, 0) / (2 * DIFFERENCE_RAD)
    return columns


def _least_change(constraints: Constraints, start: F64, q0: F64, rows: I64) -> tuple[F64, F64]:
    q = start.copy()
    moving = np.arange(len(q))
    for _ in range(STEPS):
        c = constraints(q[moving], rows[moving])
        finite = np.isfinite(c).all(axis=1)
        moving, c = moving[finite], c[finite]
        if not len(moving):
            break
        j = compute_derivatives(constraints, q[moving], rows[moving])
        away = q[moving] - q0[moving]
        right_side = np.einsum("nij,nj->ni", j, away) - c
        target = np.einsum("nij,nj->ni", np.linalg.pinv(j, rcond=1e-12), right_side)
        step = target - away
        length = np.abs(step).max(axis=1)
        step *= np.minimum(1.0, LONGEST_RAD / np.maximum(length, LONGEST_RAD))[:, None]
        q[moving] += step
        moving = moving[length > ARRIVED]
    return q, _norm(constraints(q, rows))


def _damped(constraints: Constraints, start: F64, rows: I64) -> tuple[F64, F64]:
    """Minimise the constraints' square from *start* (m, N) by Levenberg–Marquardt.

    Return angles and norms (m,).
    """
    q, miss = start.copy(), _norm(constraints(start, rows))
    damping = np.full(len(q), 1e-3)
    moving = np.flatnonzero(np.isfinite(miss))
    for _ in range(DAMPED_STEPS):
        if not len(moving):
            break
        at_q, chosen = q[moving], rows[moving]
        j, c = compute_derivatives(constraints, at_q, chosen), constraints(at_q, chosen)
        normal = np.einsum("nij,nik->njk", j, j) + damping[moving, None, None] * np.eye(q.shape[1])
        step = -np.linalg.solve(normal, np.einsum("nij,ni->nj", j, c)[:, :, None])[:, :, 0]
        length = np.abs(step).max(axis=1)
        step *= np.minimum(1.0, LONGEST_RAD / np.maximum(length, LONGEST_RAD))[:, None]
        new = _norm(constraints(at_q + step, chosen))
        better = new < miss[moving]
        q[moving[better]] += step[better]
        miss[moving[better]] = new[better]
        damping[moving] = np.maximum(damping[moving] * np.where(better, 0.1, 10.0), 1e-15)
        moving = moving[(length > ARRIVED) & (miss[moving] > ARRIVED) & (damping[moving] < 1e3)]
    return q, miss


def _norm(c: F64) -> F64:
    length: F64 = np.linalg.norm(c, axis=1)
    return length


def _pattern(n_joints: int, number: int) -> F64:
    """Return signs (N,) that differ from joint to joint."""
    return np.random.default_rng(number).choice([-1.0, 1.0], n_joints)


def compute_inverse_condition(j: F64) -> F64:
    """Return the least singular value (m,) of matrices (m, C, N), as a share of the largest.

    0 where a matrix is not finite.
    """
    finite = np.isfinite(j).all(axis=(1, 2))
    share = np.zeros(len(j))
    if finite.any():
        values = np.linalg.svd(j[finite], compute_uv=False)
        share[finite] = values[:, -1] / values[:, 0]
    return share

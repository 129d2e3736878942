"""Angles nearest to given ones that meet constraints: Newton steps, many rows at once.

The step of a row solves J·(q − q₀) = J·(q' − q₀) − c for the least |q − q₀|, so that its fixed
point meets c = 0 and departs from q₀ along the rows of J alone: the least change. J is a central
difference, so that it has the pose's part in every term.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armd.arrays import F64, I64

#: Constraints (m, C), without unit and of the size of a radian, at angles (m, N) of these rows.
Constraints = Callable[[F64, I64], F64]

#: rad: what a central difference steps, and what no step may be larger than.
DIFFERENCE_RAD, LONGEST_RAD = 1e-4, 0.3
#: Where a step is smaller, rows have arrived; so are constraints that are met.
ARRIVED = 1e-11
MET = 1e-9
STEPS, DAMPED_STEPS = 25, 40
#: rad: starts beside the given one, for a posture from which no first step leads on.
BESIDE_RAD = (0.0, 0.02, 0.2)


def nearest(constraints: Constraints, q0: F64) -> tuple[F64, F64]:
    """Angles (n, N) rad and the constraints' norm (n,) there, for given angles (n, N).

    Where the constraints cannot be met, the angles are those that meet them best nearby.
    """
    q, miss = _least_change(constraints, q0, q0, np.arange(len(q0)))
    stuck = np.flatnonzero(~(miss <= MET))
    for number, beside in enumerate(BESIDE_RAD):
        if not len(stuck):
            break
        start = q0[stuck] + beside * _pattern(q0.shape[1], number)
        damped = _damped(constraints, start, stuck)
        better, its_miss = _least_change(constraints, damped, q0[stuck], stuck)
        damped_miss = _norm(constraints(damped, stuck))
        worse = ~(its_miss <= damped_miss)
        better[worse], its_miss[worse] = damped[worse], damped_miss[worse]
        gained = ~(its_miss >= miss[stuck])
        q[stuck[gained]], miss[stuck[gained]] = better[gained], its_miss[gained]
        stuck = stuck[~(miss[stuck] <= MET)]
    return q, miss


def derivatives(constraints: Constraints, q: F64, rows: I64) -> F64:
    """Of the constraints by the angles, (m, C, N)."""
    columns = []
    for k in range(q.shape[1]):
        step = np.zeros(q.shape[1])
        step[k] = DIFFERENCE_RAD
        ahead, back = constraints(q + step, rows), constraints(q - step, rows)
        columns.append((ahead - back) / (2 * DIFFERENCE_RAD))
    return np.stack(columns, axis=2)


def _least_change(constraints: Constraints, start: F64, q0: F64, rows: I64) -> tuple[F64, F64]:
    q = start.copy()
    moving = np.arange(len(q))
    for _ in range(STEPS):
        c = constraints(q[moving], rows[moving])
        known = np.isfinite(c).all(axis=1)
        moving, c = moving[known], c[known]
        if not len(moving):
            break
        j = derivatives(constraints, q[moving], rows[moving])
        away = q[moving] - q0[moving]
        wanted = np.einsum("nij,nj->ni", j, away) - c
        target = np.einsum("nij,nj->ni", np.linalg.pinv(j, rcond=1e-12), wanted)
        step = target - away
        length = np.abs(step).max(axis=1)
        step *= np.minimum(1.0, LONGEST_RAD / np.maximum(length, LONGEST_RAD))[:, None]
        q[moving] += step
        moving = moving[length > ARRIVED]
    return q, _norm(constraints(q, rows))


def _damped(constraints: Constraints, start: F64, rows: I64) -> F64:
    """Levenberg–Marquardt on the constraints' square from *start* (m, N)."""
    q, c = start.copy(), constraints(start, rows)
    damping = np.full(len(q), 1e-3)
    for _ in range(DAMPED_STEPS):
        j = derivatives(constraints, q, rows)
        known = np.isfinite(j).all(axis=(1, 2)) & np.isfinite(c).all(axis=1)
        j[~known], c[~known] = 0.0, 0.0
        normal = np.einsum("nij,nik->njk", j, j) + damping[:, None, None] * np.eye(q.shape[1])
        step = -np.linalg.solve(normal, np.einsum("nij,ni->nj", j, c)[:, :, None])[:, :, 0]
        length = np.abs(step).max(axis=1)
        step *= np.minimum(1.0, LONGEST_RAD / np.maximum(length, LONGEST_RAD))[:, None]
        new = constraints(q + step, rows)
        better = _norm(new) < _norm(c)
        q[better] += step[better]
        c = np.where(better[:, None], new, c)
        damping = np.clip(np.where(better, damping / 10, damping * 10), 1e-15, 1e3)
        if (_norm(c) <= MET).all() or (
            not (better & (length > ARRIVED)).any() and (damping >= 1e3).all()
        ):
            break
    return q


def _norm(c: F64) -> F64:
    length: F64 = np.linalg.norm(c, axis=1)
    return length


def _pattern(n_joints: int, number: int) -> F64:
    """Signs (N,) that differ from joint to joint."""
    return np.random.default_rng(number).choice([-1.0, 1.0], n_joints)


def least_share(j: F64) -> F64:
    """The least singular value (m,) of matrices (m, C, N), as a share of the largest; 0 where they
    are not finite."""
    known = np.isfinite(j).all(axis=(1, 2))
    share = np.zeros(len(j))
    if known.any():
        values = np.linalg.svd(j[known], compute_uv=False)
        share[known] = values[:, -1] / values[:, 0]
    return share

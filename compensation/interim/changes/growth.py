"""A growth dated by a course that may bend: wear goes with use, and use is no straight line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from armd.arrays import F64
from armd.compensation.interim.changes.change import Change, amplitude_sizes, ramp, shapes
from armd.compensation.interim.changes.held import held
from armd.compensation.interim.evidence.likelihood import known_errors, log_student
from armd.compensation.interim.evidence.stack import Stack

#: Bends lie so many checks apart, and no more of them than this.
CHECKS_APART, MOST_BENDS = 3, 14


def growth(of: Stack, change: Change, kept: Sequence[int], firsts: Sequence[int]) -> Change:
    """A growth at its likeliest onset, one of the checks *firsts*, and the interval of onsets."""
    found = growths(of, change, kept, firsts)
    low, high = held(np.array([share for share, _ in found]))
    _, best = max(found, key=lambda one: one[0])
    return replace(best, earliest=firsts[low], latest=firsts[high])


def growths(
    of: Stack, change: Change, kept: Sequence[int], firsts: Sequence[int]
) -> list[tuple[float, Change]]:
    """A growth from each of the checks *firsts* on by a course that may bend, with its share; all
    onsets are as likely beforehand."""
    assert change.cause is not None
    some = of.only(kept)
    rate = _rate(some, change)
    # A rate that differs from column to column bends in its own proportion.
    size = np.maximum(np.abs(rate), 0.1 * np.abs(rate).max())
    apart = max(CHECKS_APART, -(-len(kept) // MOST_BENDS))
    knots = [float(some.time_d[k]) for k in range(len(kept) - 2, 0, -apart)][::-1]
    courses = []
    for first in firsts:
        origin = origin_d(of, kept, kept.index(first))
        bends = tuple(at for at in knots if at > float(of.time_d[first]))
        courses.append(replace(change, first=first, origin_d=origin, bends_d=bends, rate_size=size))
    plausible = log_marginals(some, change.cause, courses)
    share = np.exp(plausible - plausible.max())
    return list(zip((share / share.sum()).tolist(), courses, strict=True))


def _rate(of: Stack, change: Change) -> F64:
    """(p,) of a growth at one rate throughout, in typical sizes."""
    assert change.cause is not None
    block, grown = of.blocks[change.cause], ramp(of, change.origin_d)
    own = [change.size * w * x[:, block] for w, x in zip(grown, of.columns, strict=True)]
    told = known_errors(of.knowing(own).sums(range(of.n)))
    rate: F64 = change.size * told.mean[of.known[0].shape[1] :]
    return rate


def log_marginals(of: Stack, cause: int, courses: Sequence[Change]) -> F64:
    """(courses,) log of how likely all readings are with each of *courses* of a *cause*, everything
    known and the course's amplitudes integrated out.

    The same as of a stack that knows the course (`with_changes`); but what all courses have in
    common is summed up once.
    """
    own = [columns[:, of.blocks[cause]] for columns in of.columns]
    sums = of.sums(range(of.n))
    factor = cholesky(sums.curvature + np.eye(len(sums.side)), lower=True, check_finite=False)

    def cleared(side: F64) -> F64:
        found: F64 = solve_triangular(factor, side, lower=True, check_finite=False)
        return found

    cross = np.stack([known.T @ x for known, x in zip(of.known, own, strict=True)])  # (n, q, p)
    products = np.stack([x.T @ x for x in own])  # (n, p, p)
    towards = np.stack([x.T @ z for x, z in zip(own, of.residual, strict=True)])  # (n, p)
    side = cleared(sums.side)
    square = sums.square - float(side @ side)
    spread = float(np.log(np.diag(factor)).sum())
    p = own[0].shape[1]
    found = []
    for course in courses:
        shape, sizes = shapes(of, course), amplitude_sizes(course, p).ravel()
        wide = len(sizes)
        along = cleared(np.tensordot(cross, shape, (0, 0)).swapaxes(1, 2).reshape(-1, wide) * sizes)
        inner = np.einsum("nb,npr,nc->bpcr", shape, products, shape, optimize=True)
        inner = inner.reshape(wide, wide) * np.outer(sizes, sizes) - along.T @ along
        root = cholesky(inner + np.eye(wide), lower=True, check_finite=False)
        left = (shape.T @ towards).ravel() * sizes - along.T @ side
        left = solve_triangular(root, left, lower=True, check_finite=False)
        more = float(np.log(np.diag(root)).sum())
        found.append(log_student(float(sums.numbers), spread + more, square - float(left @ left)))
    return np.array(found)


def origin_d(of: Stack, kept: Sequence[int], first: int) -> float:
    """When a growth that first shows at the kept check *first* begins: at the check before."""
    if first:
        return float(of.time_d[kept[first - 1]])
    return float(of.time_d[kept[0]]) - of.gap_d

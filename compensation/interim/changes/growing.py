"""The likelihood of all readings with growths from many onsets, from sums that run backwards in
time.

A growth from o is a ramp r(o): 0 until o, and t − o at a later check at time t. For each check,
products of two quantities are summed over this and all later checks, times the 0th, 1st and 2nd
power of the time since that check. The product of any two ramps follows from these sums:

    Σ r(a)·r(b)·P = Σ r(b)²·P + (b − a)·Σ r(b)·P,   a ≤ b

So one pass over the checks serves all onsets and bends. The time factors are all positive, so no
digits cancel.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from armd.arrays import F64, I64
from armd.compensation.interim.changes.change import Change, list_amplitude_sizes
from armd.compensation.interim.evidence.elimination import eliminate_standing
from armd.compensation.interim.evidence.likelihood import compute_log_student
from armd.compensation.interim.evidence.stack import RAMP_DAYS, Stack


class Growing:
    """A stack with all known errors eliminated, to evaluate growths of one cause after another."""

    def __init__(self, stack: Stack) -> None:
        sums = stack.sum_checks(range(stack.n))
        # The standing errors have the size that the stack assumes.
        eliminated = eliminate_standing(sums.curvature, sums.side, sums.square, slice(0), (1.0,))
        self._stack = stack
        self._rotated = [
            eliminated.rotation @ columns.T for columns in stack.error_columns
        ]  # per check (q, r)
        self._side = eliminated.side
        self._squared_norm = float(eliminated.square[0])
        self._spread = float(eliminated.spread[0])
        self._numbers = float(sums.numbers)

    def rate(self, change: Change) -> F64:
        """Estimate the rate (p,) of a growth that has one rate throughout, in typical sizes."""
        assert change.cause is not None
        ramps = _Ramps(self._stack, change.cause, self._rotated, self._side)
        gram, side = ramps.products(np.array([change.origin_d]))
        curvature = np.eye(side.shape[1]) + change.size**2 * gram[0]
        rate: F64 = change.size**2 * np.linalg.solve(curvature, side[0])
        return rate

    def log_marginals(self, cause: int, courses: Sequence[Change]) -> F64:
        """Return the log marginal likelihood (courses,) of all readings with each of *courses* of a
        *cause*.

        The known errors and the course's amplitudes are integrated out. The result equals that of a
        stack that contains the course as a known change (`add_known_changes`). Courses that bend at
        the same instants, all after their origins, share their `rate_size`; their `bending` may
        differ.
        """
        ramps = _Ramps(self._stack, cause, self._rotated, self._side)
        logs: list[float] = []
        for (bends, _), group in groupby(
            courses, lambda candidate: (candidate.bends_d, candidate.bending)
        ):
            members = list(group)
            origins = np.array([course.origin_d for course in members])
            spread, explained = ramps.integrated(origins, np.array(bends), members[0])
            logs += [
                compute_log_student(self._numbers, self._spread + added, self._squared_norm - less)
                for added, less in zip(spread.tolist(), explained.tolist(), strict=True)
            ]
        return np.array(logs)


class _Ramps:
    """Products of ramps of one cause's p columns, with the known errors eliminated; per 30 days."""

    def __init__(self, stack: Stack, cause: int, rotated: Sequence[F64], side: F64) -> None:
        columns_of_cause = [columns[:, stack.blocks[cause]] for columns in stack.columns]
        days = stack.time_d
        self._side = side
        self._gram = _Since(days, np.stack([x.T @ x for x in columns_of_cause]))
        self._towards = _Since(
            days, np.stack([x.T @ z for x, z in zip(columns_of_cause, stack.residual, strict=True)])
        )
        self._along = _Since(
            days, np.stack([k @ x for k, x in zip(rotated, columns_of_cause, strict=True)])
        )

    def products(self, origins: F64) -> tuple[F64, F64]:
        """Return the product of each ramp with itself (m, p, p) and with the readings (m, p)."""
        along = self._along.once(origins)
        gram = self._gram.twice(origins) - along.swapaxes(1, 2) @ along
        return gram, self._towards.once(origins) - self._side @ along

    def pairs(self, a: F64, b: F64) -> F64:
        """Return the products (m p, k p) of ramps from *a* (m,) with ramps from *b* (k,)."""
        later, distance = np.maximum.outer(a, b), np.abs(np.subtract.outer(a, b)) / RAMP_DAYS
        product = self._gram.twice(later) + distance[..., None, None] * self._gram.once(later)
        m, k, p, _ = product.shape
        earlier, other_side = (
            self._along.once(starts).swapaxes(0, 1).reshape(-1, len(starts) * p)
            for starts in (a, b)
        )
        cleared: F64 = product.swapaxes(1, 2).reshape(m * p, k * p) - earlier.T @ other_side
        return cleared

    def integrated(self, origins: F64, bends: F64, like: Change) -> tuple[F64, F64]:
        """Integrate out the amplitudes of the ramps from *bends* and of the ramp from each of
        *origins* (T,).

        Returns the log of the root of the determinant (T,), and how much of the readings' squared
        norm the ramps explain (T,).
        """
        gram, side = self.products(origins)
        (first, *bend_sizes) = list_amplitude_sizes(like, side.shape[1])
        sizes = np.ravel(bend_sizes)
        gram, side = gram * np.outer(first, first) + np.eye(len(first)), side * first
        spread, explained = 0.0, 0.0
        if len(bends):
            common = self.pairs(bends, bends) * np.outer(sizes, sizes) + np.eye(len(sizes))
            root = cholesky(common, lower=True, check_finite=False)
            solved_side = _solve_triangle(root, self.products(bends)[1].ravel() * sizes)
            across = self.pairs(bends, origins) * sizes[:, None] * np.tile(first, len(origins))
            across = (
                _solve_triangle(root, across).reshape(len(sizes), len(origins), -1).swapaxes(0, 1)
            )
            gram = gram - across.swapaxes(1, 2) @ across
            side = side - solved_side @ across
            spread, explained = float(np.log(np.diag(root)).sum()), float(solved_side @ solved_side)
        roots = np.linalg.cholesky(gram)
        lefts = np.linalg.solve(roots, side[..., None])[..., 0]
        spreads = np.log(np.diagonal(roots, axis1=1, axis2=2)).sum(axis=1)
        return spread + spreads, explained + (lefts**2).sum(axis=1)


class _Since:
    """Sums of *values* (n, …) over each check and all later ones, times powers of the
    time since.
    """

    def __init__(self, time_d: F64, values: F64) -> None:
        self._time = time_d
        step = np.diff(time_d, append=time_d[-1])[:, None] / RAMP_DAYS
        flat = values.reshape(len(values), -1)
        self._shape = values.shape[1:]
        self._sums = _sum_backwards(flat)
        self._once = _sum_backwards(step * self._sums[1:])
        self._twice = _sum_backwards(2 * step * self._once[1:] + step**2 * self._sums[1:])

    def once(self, origins: F64) -> F64:
        """Return the sums (*origins, …) of *values* times the ramp from each origin."""
        places, lead = self._find_places(origins)
        return self._shaped(origins, self._once[places] + lead * self._sums[places])

    def twice(self, origins: F64) -> F64:
        """Return the sums (*origins, …) of *values* times the square of the ramp from
        each origin.
        """
        places, lead = self._find_places(origins)
        sums = self._twice[places] + 2 * lead * self._once[places] + lead**2 * self._sums[places]
        return self._shaped(origins, sums)

    def _find_places(self, origins: F64) -> tuple[I64, F64]:
        """Return the first check after each origin, and how long after, in units of `RAMP_DAYS`."""
        places = np.searchsorted(self._time, origins.ravel(), side="right")
        first = self._time[np.minimum(places, len(self._time) - 1)]
        return places, (first - origins.ravel())[:, None] / RAMP_DAYS

    def _shaped(self, origins: F64, sums: F64) -> F64:
        return sums.reshape(*origins.shape, *self._shape)


def _sum_backwards(values: F64) -> F64:
    """Return the sums (n + 1, …) of *values* (n, …) from each index to the last."""
    sums = np.zeros((len(values) + 1, *values.shape[1:]))
    np.cumsum(values[::-1], axis=0, out=sums[-2::-1])
    return sums


def _solve_triangle(factor: F64, side: F64) -> F64:
    solution: F64 = solve_triangular(factor, side, lower=True, check_finite=False)
    return solution

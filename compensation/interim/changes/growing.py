"""How likely all readings are with growths from many onsets on, by sums that run backwards.

A growth from o on is a ramp r(o): 0 until then, t − o at a check at t after it. With the sums over
all checks from one on, of what two checks make together, times the 0th, 1st and 2nd power of the
time since that check, any two ramps' product is

    Σ r(a)·r(b)·P = Σ r(b)²·P + (b − a)·Σ r(b)·P,   a ≤ b

so one pass over the checks serves all onsets and bends; nothing but what is positive is added up in
time, so nothing cancels.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from armd.arrays import F64, I64
from armd.compensation.interim.changes.change import Change, amplitude_sizes
from armd.compensation.interim.evidence.cleared import cleared
from armd.compensation.interim.evidence.likelihood import log_student
from armd.compensation.interim.evidence.stack import RAMP_DAYS, Stack


class Growing:
    """A stack with everything known eliminated, for growths of one cause after another."""

    def __init__(self, of: Stack) -> None:
        sums = of.sums(range(of.n))
        # Of the size that the stack takes them for.
        known = cleared(sums.curvature, sums.side, sums.square, slice(0), (1.0,))
        self._of = of
        self._known = [known.rotation @ one.T for one in of.known]  # per check (q, r)
        self._side = known.side
        self._square = float(known.square[0])
        self._spread = float(known.spread[0])
        self._numbers = float(sums.numbers)

    def rate(self, change: Change) -> F64:
        """(p,) of a growth at one rate throughout, in typical sizes."""
        assert change.cause is not None
        ramps = _Ramps(self._of, change.cause, self._known, self._side)
        gram, side = ramps.alone(np.array([change.origin_d]))
        curvature = np.eye(side.shape[1]) + change.size**2 * gram[0]
        rate: F64 = change.size**2 * np.linalg.solve(curvature, side[0])
        return rate

    def log_marginals(self, cause: int, courses: Sequence[Change]) -> F64:
        """(courses,) log of how likely all readings are with each of *courses* of a *cause*, with
        everything known and the course's amplitudes integrated out.

        The same as of a stack that knows the course (`with_changes`). Courses that bend at the same
        instants, all after their origins, share their `rate_size`, and bend by the same share of it
        or by another.
        """
        ramps = _Ramps(self._of, cause, self._known, self._side)
        found: list[float] = []
        for (bends, _), group in groupby(courses, lambda one: (one.bends_d, one.bending)):
            some = list(group)
            origins = np.array([course.origin_d for course in some])
            spread, told = ramps.integrated(origins, np.array(bends), some[0])
            found += [
                log_student(self._numbers, self._spread + more, self._square - less)
                for more, less in zip(spread.tolist(), told.tolist(), strict=True)
            ]
        return np.array(found)


class _Ramps:
    """Products of ramps of one cause's p columns, what is known eliminated; per 30 days."""

    def __init__(self, of: Stack, cause: int, known: Sequence[F64], side: F64) -> None:
        own = [columns[:, of.blocks[cause]] for columns in of.columns]
        days = of.time_d
        self._side = side
        self._own = _Since(days, np.stack([x.T @ x for x in own]))
        self._towards = _Since(
            days, np.stack([x.T @ z for x, z in zip(own, of.residual, strict=True)])
        )
        self._along = _Since(days, np.stack([k @ x for k, x in zip(known, own, strict=True)]))

    def alone(self, origins: F64) -> tuple[F64, F64]:
        """Each ramp with itself (m, p, p), and with the readings (m, p)."""
        along = self._along.once(origins)
        gram = self._own.twice(origins) - along.swapaxes(1, 2) @ along
        return gram, self._towards.once(origins) - self._side @ along

    def pairs(self, a: F64, b: F64) -> F64:
        """Ramps from *a* (m,) with those from *b* (k,), (m p, k p)."""
        later, apart = np.maximum.outer(a, b), np.abs(np.subtract.outer(a, b)) / RAMP_DAYS
        plain = self._own.twice(later) + apart[..., None, None] * self._own.once(later)
        m, k, p, _ = plain.shape
        left, right = (
            self._along.once(at).swapaxes(0, 1).reshape(-1, len(at) * p) for at in (a, b)
        )
        cleared: F64 = plain.swapaxes(1, 2).reshape(m * p, k * p) - left.T @ right
        return cleared

    def integrated(self, origins: F64, bends: F64, like: Change) -> tuple[F64, F64]:
        """Amplitudes of the ramps from *bends* on and of each from *origins* (T,) on integrated
        out: log of the determinant's root (T,), and what they explain of the readings' square."""
        gram, side = self.alone(origins)
        (first, *others) = amplitude_sizes(like, side.shape[1])
        sizes = np.ravel(others)
        gram, side = gram * np.outer(first, first) + np.eye(len(first)), side * first
        spread, told = 0.0, 0.0
        if len(bends):
            common = self.pairs(bends, bends) * np.outer(sizes, sizes) + np.eye(len(sizes))
            root = cholesky(common, lower=True, check_finite=False)
            left = _solved(root, self.alone(bends)[1].ravel() * sizes)
            across = self.pairs(bends, origins) * sizes[:, None] * np.tile(first, len(origins))
            across = _solved(root, across).reshape(len(sizes), len(origins), -1).swapaxes(0, 1)
            gram = gram - across.swapaxes(1, 2) @ across
            side = side - left @ across
            spread, told = float(np.log(np.diag(root)).sum()), float(left @ left)
        roots = np.linalg.cholesky(gram)
        lefts = np.linalg.solve(roots, side[..., None])[..., 0]
        spreads = np.log(np.diagonal(roots, axis1=1, axis2=2)).sum(axis=1)
        return spread + spreads, told + (lefts**2).sum(axis=1)


class _Since:
    """Sums of *of* (n, …) over all checks from each on, times powers of the time since."""

    def __init__(self, time_d: F64, of: F64) -> None:
        self._time = time_d
        step = np.diff(time_d, append=time_d[-1])[:, None] / RAMP_DAYS
        flat = of.reshape(len(of), -1)
        self._shape = of.shape[1:]
        self._sums = _backwards(flat)
        self._once = _backwards(step * self._sums[1:])
        self._twice = _backwards(2 * step * self._once[1:] + step**2 * self._sums[1:])

    def once(self, origins: F64) -> F64:
        """(*origins, …) the ramp from each origin on, times *of*."""
        at, lead = self._at(origins)
        return self._shaped(origins, self._once[at] + lead * self._sums[at])

    def twice(self, origins: F64) -> F64:
        """The same of the ramp's square."""
        at, lead = self._at(origins)
        found = self._twice[at] + 2 * lead * self._once[at] + lead**2 * self._sums[at]
        return self._shaped(origins, found)

    def _at(self, origins: F64) -> tuple[I64, F64]:
        """The first check after each origin, and how long after."""
        at = np.searchsorted(self._time, origins.ravel(), side="right")
        first = self._time[np.minimum(at, len(self._time) - 1)]
        return at, (first - origins.ravel())[:, None] / RAMP_DAYS

    def _shaped(self, origins: F64, found: F64) -> F64:
        return found.reshape(*origins.shape, *self._shape)


def _backwards(of: F64) -> F64:
    """(n + 1, …) sums of *of* (n, …) from each on."""
    sums = np.zeros((len(of) + 1, *of.shape[1:]))
    np.cumsum(of[::-1], axis=0, out=sums[-2::-1])
    return sums


def _solved(factor: F64, side: F64) -> F64:
    found: F64 = solve_triangular(factor, side, lower=True, check_finite=False)
    return found

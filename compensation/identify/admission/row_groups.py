"""Search for rows in one stretch of time that need separate parameters.

Around a fit to all readings, everything is linear. Constants, placements and seats are projected
out once. Then a group of rows with separate columns costs a few small products. So every stretch
between two edges of a grid is tried, and its ends are refined to single rows.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.estimate.noise.robust import compute_huber_weights
from armd.compensation.identify.fit import Identification

#: The least size of a group and of the rest: fewer rows are single wrong readings.
LEAST_ROWS = 8
#: The number of intervals in the grid of stretches, besides the sessions' own ends.
GRID = 48
#: Larger residuals count as this many times the median (Huber).
EDGE = 3.0
#: Larger problems (3 n equations times columns) are not searched: 160 MB.
MOST_CELLS = 20_000_000
#: A direction of scaled columns is absorbed if its squared norm is below this share: the limits are
#: for nuisances among themselves, and for a group's columns among the nuisances.
ABSORBED, ABSORBED_GROUP = 1e-10, 1e-5


@dataclass(frozen=True)
class GroupGain:
    """The gain of separate columns for a group of rows."""

    group: Mask  # (n,) rows in the order of the observations
    step: F64  # (c,) coefficients of the columns, in the group
    residual_share: float  # share of the squared residuals that remains
    n_unabsorbed: int  # columns that the other unknowns do not absorb


@dataclass(frozen=True)
class ClearedRows:
    """Whitened rows in the order of measurement, with all fitted unknowns projected out."""

    order: I64  # (n,) rows of the observations
    weight: F64  # (n,) square roots of Huber's weights
    basis: F64  # (n, 3, p) orthonormal basis of the fitted columns
    residual: F64  # (n, 3) orthogonal to the basis
    edges: I64  # of the grid, with 0 and n

    @property
    def squared_sum(self) -> float:
        """The sum of the squared residuals."""
        return float((self.residual**2).sum())

    def best_stretch(self, columns: F64) -> GroupGain | None:
        """Find the stretch of rows that gains most by separate *columns* (n, 3, c)."""
        ordered = self._ordered(columns)
        first, end = self._best(ordered, self.edges, self.edges)
        if end <= first:
            return None
        for _ in range(2):
            first = self._best(ordered, self._list_rows_near(first), np.array([end]))[0]
            end = self._best(ordered, np.array([first]), self._list_rows_near(end))[1]
        group = np.zeros(len(self.order), dtype=bool)
        group[self.order[first:end]] = True
        return self.gain(columns, group)

    def gain(self, columns: F64, group: Mask) -> GroupGain:
        """Compute the gain of separate *columns* (n, 3, c) for the rows of *group* (n,)."""
        ordered = self._ordered(columns) * group[self.order][:, None, None]
        shared = np.einsum("nip,nic->pc", self.basis, ordered)
        gram = np.einsum("nic,nid->cd", ordered, ordered)
        slope = np.einsum("nic,ni->c", ordered, self.residual)
        step, gained, n_unabsorbed = _solve(gram[None], shared[None], slope[None])
        share = 1.0 - float(gained[0]) / max(self.squared_sum, 1e-300)
        return GroupGain(group, step[0], share, int(n_unabsorbed[0]))

    def _ordered(self, columns: F64) -> F64:
        whitened: F64 = self.weight[:, None, None] * columns[self.order]
        return whitened

    def _list_rows_near(self, edge: int) -> I64:
        """List every row from the grid edge before *edge* to the grid edge after it."""
        k = int(np.searchsorted(self.edges, edge))
        low, high = self.edges[max(k - 1, 0)], self.edges[min(k + 1, len(self.edges) - 1)]
        return np.arange(low, high + 1)

    def _best(self, ordered: F64, firsts: I64, ends: I64) -> tuple[int, int]:
        """Find the stretch from one of *firsts* to before one of *ends* that gains most.

        Return (0, 0) where no stretch is long enough.
        """
        edges = np.unique(np.concatenate([[0], firsts, ends]))
        shared, gram, slope = self._sums(ordered, edges)
        best, stretch = -1.0, (0, 0)
        for first in firsts.tolist():
            length = ends - first
            n = len(self.order)
            long_enough = ends[(length >= LEAST_ROWS) & (length <= n - LEAST_ROWS)]
            if not len(long_enough):
                continue
            i, j = np.searchsorted(edges, first), np.searchsorted(edges, long_enough)
            _, gained, _ = _solve(gram[j] - gram[i], shared[j] - shared[i], slope[j] - slope[i])
            k = int(np.argmax(gained))
            if gained[k] > best:
                best, stretch = float(gained[k]), (first, int(long_enough[k]))
        return stretch

    def _sums(self, ordered: F64, edges: I64) -> tuple[F64, F64, F64]:
        """Compute products (E, p, c), (E, c, c), (E, c) of all rows before each edge."""
        p, c = self.basis.shape[2], ordered.shape[2]
        shared = np.zeros((len(edges), p, c))
        gram, slope = np.zeros((len(edges), c, c)), np.zeros((len(edges), c))
        for k, (low, high) in enumerate(itertools.pairwise(edges.tolist()), 1):
            rows = ordered[low:high].reshape(-1, c)
            shared[k] = shared[k - 1] + self.basis[low:high].reshape(-1, p).T @ rows
            gram[k] = gram[k - 1] + rows.T @ rows
            slope[k] = slope[k - 1] + rows.T @ self.residual[low:high].ravel()
        return shared, gram, slope


def clear_rows(identification: Identification, without: I64) -> ClearedRows | None:
    """Project all fitted unknowns out of the residuals of *identification*.

    The rows *without* get the weight 0. Return None where the problem is too small or too large.
    """
    observations, linearisation = identification.observations, identification.linearisation
    n = observations.n
    placements, targets = np.unique(observations.placement), _list_seats(identification)
    columns = identification.unknowns.columns(
        linearisation.jacobian, linearisation.basis, identification.terms
    )
    total = columns.shape[2] + 6 * len(placements) + 3 * len(targets)
    if n < 2 * LEAST_ROWS or 3 * n * total > MOST_CELLS:
        return None
    order = order_by_acquisition(identification)
    size_mm = np.linalg.norm(linearisation.residual_mm, axis=1)
    usual_mm = max(float(np.median(size_mm)), 1e-12)
    weight = np.sqrt(compute_huber_weights(size_mm / usual_mm, EDGE))
    weight[without] = 0.0
    poses = _spread_columns(observations.placement, placements, linearisation.pose_columns)
    seats = _spread_columns(observations.target, targets, linearisation.target_columns)
    nuisances = np.concatenate([columns, poses, seats], axis=2) * weight[:, None, None]
    basis = _orthonormalise(nuisances.reshape(3 * n, total)).reshape(n, 3, -1)[order]
    residual = (weight[:, None] * linearisation.residual_mm)[order]
    residual = residual - basis @ np.einsum("nip,ni->p", basis, residual)
    ends = np.flatnonzero(np.diff(observations.session[order])) + 1
    even = np.linspace(0, n, GRID + 1).round().astype(np.int64)
    return ClearedRows(order, weight[order], basis, residual, np.unique(np.append(even, ends)))


def order_by_acquisition(identification: Identification) -> I64:
    """Return the rows (n,) in the order of measurement: sessions by start, rows by time."""
    observations = identification.observations
    time_s = observations.states.time_s
    started_s = np.full(len(observations.session_names), np.inf)
    np.fmin.at(started_s, observations.session, time_s)
    return np.lexsort(
        (observations.row, time_s, observations.session, started_s[observations.session])
    )


def _list_seats(identification: Identification) -> I64:
    """List the touched targets that have no certified position."""
    observations = identification.observations
    touched = np.unique(observations.target[~observations.has_truth])
    return touched[observations.unknown[touched]]


def _spread_columns(number: I64, numbers: Sequence[int] | I64, columns: F64) -> F64:
    """Place the *columns* (n, 3, m) of each row at its *number* (n,); return (n, 3, k m)."""
    n, m = len(number), columns.shape[2]
    spread = np.zeros((n, 3, len(numbers), m))
    row, place = np.nonzero(number[:, None] == np.asarray(numbers))
    spread[row, :, place] = columns[row]
    return spread.reshape(n, 3, -1)


def _orthonormalise(columns: F64) -> F64:
    """Return an orthonormal basis (3 n, p) of the span of *columns* (3 n, c)."""
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0.0] / size[size > 0.0]
    value, vector = np.linalg.eigh(scaled.T @ scaled)
    is_independent = value > ABSORBED * len(value)
    basis: F64 = scaled @ (vector[:, is_independent] / np.sqrt(value[is_independent]))
    return basis


def _solve(gram: F64, shared: F64, slope: F64) -> tuple[F64, F64, I64]:
    """Solve for k groups: steps (k, c), their gains (k,), numbers of unabsorbed columns (k,)."""
    size = np.sqrt(np.einsum("kcc->kc", gram))
    size = np.where(size > 0.0, size, 1.0)
    reduced_gram = (gram - shared.transpose(0, 2, 1) @ shared) / (
        size[:, :, None] * size[:, None, :]
    )
    value, vector = np.linalg.eigh(reduced_gram)
    is_unabsorbed = value > ABSORBED_GROUP
    inverse = np.where(is_unabsorbed, 1.0 / np.where(is_unabsorbed, value, 1.0), 0.0)
    along = np.einsum("kcd,kc->kd", vector, slope / size)
    step = -np.einsum("kcd,kd->kc", vector, inverse * along) / size
    return step, (inverse * along**2).sum(axis=1), is_unabsorbed.sum(axis=1)

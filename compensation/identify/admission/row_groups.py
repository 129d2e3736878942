"""Search for rows in one stretch of time that want parameters of their own.

Around a fit to all readings, everything is linear. Constants, placements and seats are projected
out once. A group of rows with columns of its own then costs a few small products, so every
stretch between two edges of a grid is tried, and its ends are refined to single rows.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.estimate.noise.robust import compute_huber_weights
from armd.compensation.identify.fit import Identification

#: A group and the rest have at least so many rows: fewer are single readings gone wrong.
LEAST_ROWS = 8
#: Edges of the grid of stretches, besides the sessions' own.
GRID = 48
#: Residuals count as this many times the middle one at most (Huber).
EDGE = 3.0
#: Larger problems (3 n equations times columns) are not searched: 160 MB.
MOST_CELLS = 20_000_000
#: Directions of scaled columns whose squared norm is a smaller share are absorbed: of the nuisances
#: by each other, of a group by the nuisances.
ABSORBED, ABSORBED_GROUP = 1e-10, 1e-5


@dataclass(frozen=True)
class GroupGain:
    """What columns of its own bring a group of rows."""

    group: Mask  # (n,) rows as the observations have them
    step: F64  # (c,) of the columns, in the group
    residual_share: float  # of the squared residuals that remains
    n_unabsorbed: int  # columns that the other unknowns do not absorb


@dataclass(frozen=True)
class ClearedRows:
    """Rows in the order of their measurement, whitened, clear of everything that the fit fits."""

    order: I64  # (n,) rows of the observations
    weight: F64  # (n,) roots of Huber's weights
    basis: F64  # (n, 3, p) orthonormal columns of what is fitted
    residual: F64  # (n, 3) clear of it
    edges: I64  # grid, 0 and n among them

    @property
    def squared_sum(self) -> float:
        """Sum of the squared residuals."""
        return float((self.residual**2).sum())

    def best_stretch(self, columns: F64) -> GroupGain | None:
        """The rows in one stretch that gain most by *columns* (n, 3, c) of their own."""
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
        """What *columns* (n, 3, c) of their own bring the rows of *group* (n,)."""
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
        """Every row from the last edge of the grid before *edge* to the next one after it."""
        k = int(np.searchsorted(self.edges, edge))
        low, high = self.edges[max(k - 1, 0)], self.edges[min(k + 1, len(self.edges) - 1)]
        return np.arange(low, high + 1)

    def _best(self, ordered: F64, firsts: I64, ends: I64) -> tuple[int, int]:
        """The stretch from one of *firsts* to before one of *ends* that gains most; (0, 0) where
        none is long enough."""
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
        """Products (E, p, c), (E, c, c), (E, c) of all rows before each edge."""
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
    """Project everything that *identification* fits out of its residuals, the rows *without*
    counting for nothing; None where that is too large."""
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
    """(n,) rows in the order of their measurement: sessions by their start, rows by their time."""
    observations = identification.observations
    time_s = observations.states.time_s
    started_s = np.full(len(observations.session_names), np.inf)
    np.fmin.at(started_s, observations.session, time_s)
    return np.lexsort(
        (observations.row, time_s, observations.session, started_s[observations.session])
    )


def _list_seats(identification: Identification) -> I64:
    """Targets without a certified position that readings touch."""
    observations = identification.observations
    touched = np.unique(observations.target[~observations.has_truth])
    return touched[observations.unknown[touched]]


def _spread_columns(number: I64, numbers: Sequence[int] | I64, columns: F64) -> F64:
    """(n, 3, k m) *columns* (n, 3, m) of each row at the place of its *number* (n,)."""
    n, m = len(number), columns.shape[2]
    spread = np.zeros((n, 3, len(numbers), m))
    row, place = np.nonzero(number[:, None] == np.asarray(numbers))
    spread[row, :, place] = columns[row]
    return spread.reshape(n, 3, -1)


def _orthonormalise(columns: F64) -> F64:
    """An orthonormal basis (3 n, p) of what *columns* (3 n, c) span."""
    size = np.linalg.norm(columns, axis=0)
    scaled = columns[:, size > 0.0] / size[size > 0.0]
    value, vector = np.linalg.eigh(scaled.T @ scaled)
    is_independent = value > ABSORBED * len(value)
    basis: F64 = scaled @ (vector[:, is_independent] / np.sqrt(value[is_independent]))
    return basis


def _solve(gram: F64, shared: F64, slope: F64) -> tuple[F64, F64, I64]:
    """Steps (k, c), what they gain (k,), and how many columns tell (k,), of k groups."""
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

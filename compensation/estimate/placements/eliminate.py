"""Elimination of placements and free targets from the problem of many sessions at once.

A row touches one target only. So products with targets are sums over the rows of each target. The
sessions of a batch have equally many free targets and are solved as one stack of matrices.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.estimate.linear.linear_model import factorise_known, factorise_lower

#: Rows and sessions of a batch take about so many numbers in memory at most.
MOST_NUMBERS = 1 << 20


@dataclass(frozen=True)
class SessionColumns:
    """A session's rows, placement by placement, each ordered by target, and its K free targets."""

    number: int
    rows: Mapping[int, I64]
    targets: I64  # (K,)


@dataclass(frozen=True)
class EliminatedSession:
    """The products of c other columns, a session's p placements and K targets eliminated."""

    columns: SessionColumns
    pose_factor: F64  # (p, 6, 6) times its transpose the poses' covariance, all others fixed
    pose_projected: F64  # (p, 6, 3 K + c) the factor's transpose times the products with others
    shift_factor: F64  # (3 K, 3 K) likewise of the targets, poses being fitted along
    shift_projected: F64  # (3 K, c)
    rank: int  # degrees of freedom that poses and targets took
    gram: F64  # (c, c) products of the others after elimination
    squared_norm: F64  # (c,) squared lengths of the others before elimination

    @classmethod
    def make_weightless(cls, columns: SessionColumns, c: int) -> EliminatedSession:
        """Make it for a session without weight and without free targets: views of zeros."""
        p, nothing = len(columns.rows), np.zeros(1)
        pose, projected, shift, gram, square = (
            np.broadcast_to(nothing, shape) for shape in ((p, 6, 6), (p, 6, c), (0, c), (c, c), c)
        )
        return cls(columns, pose, projected, np.zeros((0, 0)), shift, 0, gram, square)

    @property
    def following(self) -> F64:
        """The derivative (3 K, c) of the targets' shifts by amplitudes of the others."""
        return -self.shift_factor @ self.shift_projected

    def follow(self, amplitudes: F64) -> tuple[F64, F64]:
        """Return the best twists (p, 6) and shifts (3 K,) for *amplitudes* (c,) of the others."""
        shifts = -self.shift_factor @ (self.shift_projected @ amplitudes)
        along = self.pose_projected @ np.append(shifts, amplitudes)
        return -np.einsum("pij,pj->pi", self.pose_factor, along), shifts


def split_into_batches(sessions: Sequence[SessionColumns], c: int) -> list[list[SessionColumns]]:
    """Split *sessions* into batches with equally many free targets, none of them large."""
    batches: list[list[SessionColumns]] = []
    numbers = 0
    for session in sorted(sessions, key=lambda session: len(session.targets)):
        k = len(session.targets)
        size = sum(map(len, session.rows.values())) * 6 * (c + 9) + (3 * k + c) ** 2
        numbers += size
        if not batches or len(batches[-1][0].targets) != k or numbers > MOST_NUMBERS:
            batches.append([])
            numbers = size
        batches[-1].append(session)
    return batches


def eliminate(
    sessions: Sequence[SessionColumns],
    whitened: Callable[[I64], tuple[F64, F64]],
    touched: I64,
    certified: Callable[[int], tuple[F64, F64]] | None,
) -> list[EliminatedSession]:
    """Eliminate poses, then targets, of a batch of *sessions*.

    *whitened* returns, for rows (m,), columns (m, 3, 6 + c) with poses first, and their targets'
    columns (m, 3, 3). *touched* (n,): each row's target among its session's free ones, -1 if it is
    not free. *certified* returns, for a session's number, rows (E, 3 K) of its targets and
    residuals (E,), which count in the last column.
    """
    parts = [rows for session in sessions for rows in session.rows.values()]
    counts = [len(session.rows) for session in sessions]
    first_part = np.concatenate([[0], np.cumsum(counts)])
    rows = np.concatenate(parts)
    edges = np.concatenate([[0], np.cumsum([len(part) for part in parts])])
    columns, of_target = whitened(rows)
    c, k = columns.shape[2] - 6, len(sessions[0].targets)
    gram = np.empty((len(parts), 6 + c, 6 + c))
    for i, (low, high) in enumerate(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True)):
        flat = columns[low:high].reshape(-1, 6 + c)
        gram[i] = flat.T @ flat
    reduced = np.add.reduceat(gram[:, 6:, 6:], first_part[:-1], axis=0)
    squares = np.einsum("sii->si", reduced).copy()
    across = np.zeros((len(parts), 6, 3 * k + c))
    across[:, :, 3 * k :] = gram[:, :6, 6:]
    of_targets = np.zeros((len(sessions), 3 * k, 3 * k))
    meeting = np.zeros((len(sessions), 3 * k, c))
    if k:
        part = np.repeat(np.arange(len(parts)), np.diff(edges))
        sums, part, slot = _sum_by_target(columns, of_target, part, touched[rows])
        by_target = across[:, :, : 3 * k].reshape(len(parts), 6, k, 3)
        by_target[part, :, slot] = sums[:, :, 3:9].transpose(0, 2, 1)
        across[:, :, : 3 * k] = by_target.reshape(len(parts), 6, 3 * k)
        session = np.repeat(np.arange(len(sessions)), counts)[part]
        by_slot = np.zeros((len(sessions), k, 3, 3 + c))
        np.add.at(by_slot, (session, slot), sums[:, :, [0, 1, 2, *range(9, 9 + c)]])
        meeting[:] = by_slot[:, :, :, 3:].reshape(meeting.shape)
        diagonal = of_targets.reshape(len(sessions), k, 3, k, 3)
        diagonal[:, np.arange(k), :, np.arange(k)] = by_slot[:, :, :, :3].transpose(1, 0, 2, 3)
    shift_unit = _compute_unit(np.einsum("sii->si", of_targets))
    pose_factor, pose_rank = _factorise(
        gram[:, :6, :6], _compute_unit(np.einsum("pii->pi", gram)[:, :6])
    )
    projected = pose_factor.transpose(0, 2, 1) @ across
    for s, session_columns in enumerate(sessions):
        projected_rows = projected[first_part[s] : first_part[s + 1]].reshape(-1, 3 * k + c)
        by_targets, by_others = projected_rows[:, : 3 * k], projected_rows[:, 3 * k :]
        of_targets[s] -= by_targets.T @ by_targets
        meeting[s] -= by_targets.T @ by_others
        reduced[s] -= by_others.T @ by_others
        if certified:  # not part of `shift_unit`, which is by the readings alone
            certificate, missed = certified(session_columns.number)
            of_targets[s] += certificate.T @ certificate
            meeting[s, :, -1] += missed @ certificate
            reduced[s, -1, -1] += missed @ missed
    shift_factor, shift_rank = _factorise(of_targets, shift_unit)
    shift_projected = shift_factor.transpose(0, 2, 1) @ meeting
    reduced -= shift_projected.transpose(0, 2, 1) @ shift_projected
    rank = shift_rank + np.add.reduceat(pose_rank, first_part[:-1])
    return [
        EliminatedSession(
            session, pose_factor[low:high], projected[low:high], shift_factor[s],
            shift_projected[s], int(rank[s]), reduced[s], squares[s],
        )
        for s, (session, low, high) in enumerate(
            zip(sessions, first_part[:-1], first_part[1:], strict=True)
        )
    ]  # fmt: skip


def _sum_by_target(columns: F64, of_target: F64, part: I64, slot: I64) -> tuple[F64, I64, I64]:
    """Sum products (g, 3, 3 + 6 + c) of each target's columns with themselves and all others.

    A sum is over the rows of one *part* (m,) and *slot* (m,). The part and slot of each sum are
    returned, too.
    """
    starts = np.flatnonzero(np.r_[True, (np.diff(part) != 0) | (np.diff(slot) != 0)])
    counts = np.diff(np.append(starts, len(part)))
    is_free = slot[starts] >= 0
    starts, counts = starts[is_free], counts[is_free]
    stacked = np.concatenate([of_target, columns], axis=2)
    sums = np.empty((len(starts), 3, stacked.shape[2]))
    for count in np.unique(counts).tolist():  # targets with equally many rows form one stack
        alike = counts == count
        rows = stacked[starts[alike, None] + np.arange(count)].reshape(
            -1, 3 * count, stacked.shape[2]
        )
        sums[alike] = rows[:, :, :3].transpose(0, 2, 1) @ rows
    return sums, part[starts], slot[starts]


def _compute_unit(squared_norm: F64) -> F64:
    """Return the largest squared length (s,) of columns (s, m); a zero column counts as 1."""
    lengths = np.where(squared_norm > 0.0, squared_norm, 1.0)
    return lengths.max(axis=1, initial=0.0) if lengths.shape[1] else np.ones(len(lengths))


def _factorise(matrices: F64, unit: F64) -> tuple[F64, I64]:
    """Return F (s, m, m) with F Fᵀ the inverse of *matrices* (s, m, m) along known directions.

    Directions are known relative to the *unit* (s,) of each matrix; other columns are zero. The
    number (s,) of known directions is returned, too.
    """
    scaled = matrices / unit[:, None, None]
    factors = np.zeros_like(scaled)
    ranks = np.zeros(len(scaled), dtype=np.int64)
    is_known = np.any(scaled, axis=(1, 2))
    numbers = np.flatnonzero(is_known).tolist()
    for i, lower in zip(numbers, factorise_lower(scaled[is_known]), strict=True):
        factor = factorise_known(scaled[i], lower)
        ranks[i] = factor.shape[1]
        factors[i, :, : ranks[i]] = factor
    factors /= np.sqrt(unit)[:, None, None]
    return factors, ranks

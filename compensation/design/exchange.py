"""D-optimal choice among candidate readings: greedy and random starts, then Fedorov's exchanges.

V. V. Fedorov, Theory of Optimal Experiments, 1972. The criterion is the determinant of the
constants' information with the nuisances eliminated (D_s-optimal): det M / det M_nuisances. Its
change by one more reading is a determinant of the reading's own size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.design.observability import (
    ReadingColumns,
    count_directions,
    eliminate_nuisances,
)

#: Prior, as a share of the information of all candidates: makes a start of few readings invertible.
RIDGE = 1e-9
#: Starts besides the greedy one, because exchanges end in a local optimum.
RANDOM_STARTS = 4
#: Exchanges that are tried from each start: this bounds the work, not the time.
MOST_TRIALS = 600
#: The least rise of the log determinant for which readings are exchanged.
LEAST_RISE = 1e-6


@dataclass(frozen=True)
class Candidates:
    """Candidate rows, in coordinates in which all candidates have unit information in total."""

    rows: F64  # (n, r, k + m), nuisances first
    nuisances: int  # k
    base: F64  # (k + m, k + m) information without any reading


def make_candidates(columns: ReadingColumns, fixed: F64 | None = None) -> Candidates:
    """Make candidates of the columns of readings.

    *fixed* (D, k): rows of the nuisances alone, which are known in any case.
    """
    n, r, _ = columns.nuisances.shape
    basis, free_columns = eliminate_nuisances(columns, fixed)
    u, s, _ = np.linalg.svd(free_columns, full_matrices=False)
    rows = np.hstack([basis, u[:, : count_directions(s)]])
    base = RIDGE * np.eye(rows.shape[1]) + rows[n * r :].T @ rows[n * r :]
    return Candidates(rows[: n * r].reshape(n, r, -1), basis.shape[1], base)


def compute_log_determinant(candidates: Candidates, chosen: list[int]) -> float:
    """Compute the log determinant of the constants' information, relative to all candidates."""
    total = _information(candidates, chosen)
    k = candidates.nuisances
    return float(np.linalg.slogdet(total)[1] - np.linalg.slogdet(total[:k, :k])[1])


def choose_readings(candidates: Candidates, count: int, group: I64, seed: int = 0) -> list[int]:
    """Choose *count* different candidates: the best of exchanges from a greedy and random starts.

    Each *group* (n,) of candidates, numbered from 0, gets as many readings as the others, as far as
    it has them.
    """
    shares = split_count(count, np.bincount(group))
    rng = np.random.default_rng(seed)
    starts = [_greedy_start(candidates, shares, group)]
    for _ in range(RANDOM_STARTS):
        drawn = [
            rng.choice(np.flatnonzero(group == g), share, replace=False)
            for g, share in enumerate(shares)
        ]
        starts.append(np.concatenate(drawn).tolist())
    ends = [replace_readings(candidates, start, group) for start in starts]
    return max(ends, key=lambda chosen: compute_log_determinant(candidates, chosen))


def _greedy_start(candidates: Candidates, shares: I64, group: I64) -> list[int]:
    open_shares, chosen = shares.copy(), list[int]()
    for _ in range(int(shares.sum())):
        rise = _rises(candidates, _information(candidates, chosen))
        rise[chosen] = -np.inf
        rise[open_shares[group] == 0] = -np.inf
        chosen.append(int(np.argmax(rise)))
        open_shares[group[chosen[-1]]] -= 1
    return chosen


def split_count(count: int, sizes: I64) -> I64:
    """Split *count* evenly over groups, with no share above a group's size."""
    shares = np.zeros_like(sizes)
    while shares.sum() < min(count, sizes.sum()):
        open_ = np.flatnonzero(shares < sizes)
        shares[open_[: count - shares.sum()]] += 1
    return shares


def replace_readings(candidates: Candidates, chosen: list[int], group: I64) -> list[int]:
    """Exchange each of *chosen* in turn for the best of its group, while that helps."""
    chosen, unchanged = list(chosen), 0
    for trial in range(MOST_TRIALS):
        place = trial % len(chosen)
        unchanged_readings = chosen[:place] + chosen[place + 1 :]
        rise = _rises(candidates, _information(candidates, unchanged_readings))
        now = rise[chosen[place]]
        rise[unchanged_readings] = -np.inf
        rise[group != group[chosen[place]]] = -np.inf
        best = int(np.argmax(rise))
        unchanged += 1
        if rise[best] > now + LEAST_RISE:
            chosen[place], unchanged = best, 0
        if unchanged == len(chosen):
            break
    return chosen


def _information(candidates: Candidates, chosen: list[int]) -> F64:
    rows = candidates.rows[chosen].reshape(-1, candidates.rows.shape[2])
    total: F64 = candidates.base + rows.T @ rows
    return total


def _rises(candidates: Candidates, information: F64) -> F64:
    """Compute the rise (n,) of the constants' log determinant by one more reading."""
    k = candidates.nuisances
    total_rise = _log_rises(candidates.rows, information)
    rise: F64 = total_rise - _log_rises(candidates.rows[:, :, :k], information[:k, :k])
    return rise


def _log_rises(rows: F64, information: F64) -> F64:
    """Compute log det(I + R M⁻¹ Rᵀ) of each candidate R (r, c): the matrix determinant lemma."""
    n, r, c = rows.shape
    root = np.linalg.cholesky(information)
    white = np.linalg.solve(root, rows.reshape(n * r, c).T).T.reshape(n, r, c)
    rise: F64 = np.linalg.slogdet(np.eye(r) + white @ white.transpose(0, 2, 1))[1]
    return rise

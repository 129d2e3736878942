"""Tall columns kept placement by placement: most are zero in all placements but one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64


@dataclass(frozen=True)
class Blocks:
    """Columns (N, m), of each placement's rests those only that are not zero there."""

    size: int  # m
    pieces: tuple[tuple[I64, I64, F64], ...]  # rests (k,), columns (c,), values (k, 3, c)
    distances: F64  # (D, m)

    def products(self, whitener: F64, distance_mm: F64, residual: F64) -> F64:
        """(m + 1, m + 1) of the columns and a residual (N,) as a last one, whitened by matrices
        (n, 3, 3) and standard uncertainties (D,)."""
        n = 3 * len(whitener)
        last = np.hstack([self.distances, residual[n:, None]]) / distance_mm[:, None]
        found: F64 = last.T @ last
        by_rest = residual[:n].reshape(-1, 3, 1)
        for rests, columns, values in self.pieces:
            both = np.concatenate([values, by_rest[rests]], axis=2)
            white = (whitener[rests] @ both).reshape(-1, both.shape[2])
            at = np.append(columns, self.size)
            found[np.ix_(at, at)] += white.T @ white
        return found


def in_blocks(columns: Sequence[F64], placement: I64) -> Blocks:
    """Columns (3 n + D, …), m in all, by the *placement* (n,) of each rest."""
    n = len(placement)
    at_rests = [some[: 3 * n].reshape(n, 3, some.shape[1]) for some in columns]
    pieces = []
    for number in np.unique(placement):
        rests = np.flatnonzero(placement == number)
        values = np.concatenate([some[rests] for some in at_rests], axis=2)
        here = np.flatnonzero(values.any(axis=(0, 1)))
        pieces.append((rests, here, np.ascontiguousarray(values[:, :, here])))
    distances = np.hstack([some[3 * n :] for some in columns])
    return Blocks(distances.shape[1], tuple(pieces), distances)

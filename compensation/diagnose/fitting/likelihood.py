"""Restricted likelihood of variances, from sums of products, session by session.

−2 log likelihood of r ~ N(0, s² (I + Z diag(a) Zᵀ)) with what absorbs freely projected out (REML;
Harville 1974). Most columns stand in one session's rows only: its placements, its seats, its own
wandering base. They are eliminated there, so that a likelihood costs so much a session; what all
sessions share, some hundred columns, is left for the end.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from armd.arrays import F64, I64, Mask

_TINY = 1e-10
#: Seats that are not known turn with their artefact, nearly: whether such a direction is free is
#: then a matter of the yardstick, which is that of all columns together.
_DOUBTFUL = (1e-12, 1e-6)


@dataclass(frozen=True)
class Restricted:
    """Products of g free columns, t shared ones and the residual, all common to the groups, clear
    of what absorbs freely; and of at most m shared columns in each of S groups."""

    log_det: float  # of the rests' own covariances for s = 1
    freedom: int  # rows less the rank of what absorbs freely
    square: float  # of the residual
    n_free: int  # g
    rest: F64  # (g + t + 1, g + t + 1); of the free ones, clear of the groups' free ones, unity
    common: I64  # (t,) which variances are those of the shared ones
    own: F64  # (S, m, m) of each group's shared columns
    across: F64  # (S, m, g + t + 1) of these with the common ones
    places: I64  # (S, m) which variances; −1: no column

    @classmethod
    def of_products(
        cls, products: F64, free: Mask, owner: I64, log_det: float, rows: int
    ) -> Restricted:
        """Of whitened columns and, last, the residual (b + 1, b + 1), of so many *rows*; which
        absorb *free*ly (b,), and the *owner* (b,): the group in whose rows alone one stands, or
        −1. The variances to come are those of the others, in their order. Where a group cannot
        tell for sure what is a gauge, there are no groups."""
        together = np.full_like(owner, -1)
        variance = np.where(free, -1, np.cumsum(~free) - 1)
        everywhere = owner < 0
        mine = np.flatnonzero(free & everywhere)
        common = np.flatnonzero(~free & everywhere)
        beside = np.concatenate([mine, common, [len(free)]])
        rest = products[np.ix_(beside, beside)]
        rank, groups = 0, []
        for group in np.unique(owner[~everywhere]):
            absorbs = np.flatnonzero(free & (owner == group))
            own = np.flatnonzero(~free & (owner == group))
            own_gram = products[np.ix_(absorbs, absorbs)]
            root, sure = _root(own_gram, products.diagonal()[absorbs])
            if not sure:
                return cls.of_products(products, free, together, log_det, rows)
            rank += root.shape[1]
            to_all = np.concatenate([own, beside])
            taken = root.T @ products[np.ix_(absorbs, to_all)]
            clear = products[np.ix_(own, to_all)] - taken[:, : len(own)].T @ taken
            rest -= taken[:, len(own) :].T @ taken[:, len(own) :]
            groups.append((variance[own], clear))
        g = len(mine)
        root, sure = _root(rest[:g, :g], products.diagonal()[mine])
        if groups and not sure:
            return cls.of_products(products, free, together, log_det, rows)
        turn = np.eye(len(rest))[:, g - root.shape[1] :]
        turn[:, : root.shape[1]] = 0.0
        turn[:g, : root.shape[1]] = root
        g, rest = root.shape[1], turn.T @ rest @ turn
        freedom, taken = rows - rank - g, rest[:g, -1]
        square = float(rest[-1, -1] - taken @ taken)
        if not groups:  # nothing that varies stands between: they are eliminated once
            rest = rest[g:, g:] - rest[:g, g:].T @ rest[:g, g:]
            turn, g = turn[:, g:], 0
        size = max((len(places) for places, _ in groups), default=0)
        own_products = np.zeros((len(groups), size, size))
        across = np.zeros((len(groups), size, len(rest)))
        places = np.full((len(groups), size), -1)
        for i, (numbers, clear) in enumerate(groups):
            m = len(numbers)
            places[i, :m] = numbers
            own_products[i, :m, :m] = _not_negative(clear[:, :m])
            across[i, :m] = clear[:, m:] @ turn
        return cls(
            log_det,
            freedom,
            square,
            g,
            rest,
            variance[common],
            own_products,
            across,
            places,
        )

    def likelihood(self, scale: float, relative: F64) -> float:
        """−2 × restricted log likelihood, up to a constant, at s and variances over s²."""
        root = np.sqrt(np.append(relative, 0.0))  # the last is that of no column
        own = root[self.places]
        matrix = self.own * own[:, :, None] * own[:, None, :] + np.eye(self.own.shape[1])
        lower = np.linalg.cholesky(matrix)
        log_det = self.log_det + _log_det(np.einsum("sii->si", lower))
        towards = np.linalg.solve(lower, own[:, :, None] * self.across)
        towards = towards.reshape(-1, len(self.rest))
        rest, g = self.rest - towards.T @ towards, self.n_free
        lower = cholesky(rest[:g, :g], lower=True, check_finite=False)
        log_det += _log_det(np.diag(lower))
        towards = solve_triangular(lower, rest[:g, g:], lower=True, check_finite=False)
        rest = rest[g:, g:] - towards.T @ towards
        root = root[self.common]
        matrix = rest[:-1, :-1] * root
        matrix *= root[:, None]
        matrix.flat[:: len(root) + 1] += 1.0
        lower = cholesky(matrix, lower=True, overwrite_a=True, check_finite=False)
        log_det += _log_det(np.diag(lower))
        side = solve_triangular(lower, root * rest[:-1, -1], lower=True, check_finite=False)
        square = max(float(rest[-1, -1] - side @ side), 0.0)  # rounding may leave less
        return float(self.freedom * 2.0 * np.log(scale) + log_det + square / scale**2)


def _root(gram: F64, square: F64) -> tuple[F64, bool]:
    """R (f, r) by which columns of these products become orthonormal, a gauge among them leaving no
    trace, and whether it is sure what is one. *square* (f,): the products of each with itself,
    before anything was projected out."""
    size = np.sqrt(square)
    size[size == 0.0] = 1.0
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    kept = values > _TINY * max(float(values.max(initial=0.0)), 1.0)
    root: F64 = vectors[:, kept] / np.sqrt(values[kept]) / size[:, None]
    return root, not ((values > _DOUBTFUL[0]) & (values < _DOUBTFUL[1])).any()


def _not_negative(gram: F64) -> F64:
    """What is absorbed entirely must not come out negative by rounding."""
    values, vectors = np.linalg.eigh(gram)
    positive: F64 = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return positive


def _log_det(diagonal: F64) -> float:
    """Of the square of a triangular matrix."""
    return 2.0 * float(np.log(diagonal).sum())

"""The restricted likelihood of scale and drift, from sums of products: no rows, no large matrix.

What absorbs freely in one session alone is eliminated there, and the drift's columns, all of one
variance, are turned until their products are a diagonal: any drift then costs one pass over them.
Left is the border, what all sessions share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpotrf, dtrtrs

from armd.arrays import F64, I64, Mask
from armd.compensation.diagnose.constants import GAUGE_SQUARED, LEAST_RELATIVE, MOST_RELATIVE
from armd.compensation.estimate.linear.bordered import BorderedParts, compute_root_along_known


@dataclass(frozen=True)
class Absorbing:
    """Which of b columns absorb in one part of the rows only, and which are shared."""

    per_part: tuple[I64, ...]  # of each part, the drift's among them
    shared: I64  # free, of all parts
    with_prior: I64  # by a prior
    drifting: Mask  # (b,)
    variance: F64  # (b,) of the amplitudes, inf: free, NaN: the drift's

    @classmethod
    def from_meeting(cls, meeting: Mask, variance: F64) -> Absorbing:
        """By which columns meet each other (b, b) in some row."""
        drifting, free = np.isnan(variance), np.isinf(variance)
        inner = np.flatnonzero(drifting | free)
        parts = BorderedParts.from_matrix(meeting[np.ix_(inner, inner)])
        per_part, shared = [inner[part] for part in parts.inner_parts], inner[parts.border]
        if drifting[shared].any():
            per_part, shared = [inner], shared[:0]
        return cls(tuple(per_part), shared, np.flatnonzero(~(drifting | free)), drifting, variance)


@dataclass(frozen=True)
class Restricted:
    """Products of d columns of the drift, k others (the *free* ones first, orthonormal) and the
    residual, clear of what absorbs freely in one part of the rows."""

    curvature: F64  # (d,) squared lengths of the drift's columns, orthogonal to each other
    across: F64  # (d, k + 1) of them with the others and the residual
    gram: F64  # (k + 1, k + 1)
    variance: F64  # (k − free,) of the amplitudes that do not absorb freely
    free: int
    freedom: float  # rows less the rank of all that absorbs freely

    @classmethod
    def from_products(cls, products: F64, absorbing: Absorbing, rows: float) -> Restricted:
        """From *products* (b + 1, b + 1) of whitened columns and a residual as the last, over so
        many *rows*."""
        drifting, shared, with_prior = absorbing.drifting, absorbing.shared, absorbing.with_prior
        remaining = np.concatenate([shared, with_prior, [len(drifting)]])
        gram = products[np.ix_(remaining, remaining)]
        curvature, across, rank = [np.empty(0)], [np.empty((0, len(remaining)))], 0
        for part in absorbing.per_part:
            drift = drifting[part]
            r, cleared = _clear_of_free(products, part[~drift], part[drift], remaining)
            d = int(drift.sum())
            rank += r
            # What is absorbed entirely must not come out negative by rounding.
            values, vectors = np.linalg.eigh(cleared[:d, :d])
            curvature.append(np.maximum(values, 0.0))
            across.append(vectors.T @ cleared[:d, d:])
            gram -= cleared[d:, d:]
        f = len(shared)
        root = _root_of_free(gram[:f, :f], np.diag(products)[shared])
        turn = np.zeros((len(remaining), root.shape[1] + len(remaining) - f))
        turn[:f, : root.shape[1]] = root
        turn[f:, root.shape[1] :] = np.eye(len(remaining) - f)
        return cls(
            np.concatenate(curvature),
            np.concatenate(across) @ turn,
            turn.T @ gram @ turn,
            absorbing.variance[with_prior],
            root.shape[1],
            rows - rank - root.shape[1],
        )

    @property
    def squared_norm(self) -> float:
        """Of the residual, clear of all that absorbs freely."""
        absorbed = self.gram[: self.free, -1]
        return float(self.gram[-1, -1] - absorbed @ absorbed)

    def negative_log_likelihood(self, scale: float, drift: float) -> float:
        """−2 × restricted log likelihood, up to a constant."""
        relative = np.clip(drift**2 / scale**2, LEAST_RELATIVE, MOST_RELATIVE)
        weight = relative / (1.0 + relative * self.curvature)
        gram = self.gram - (self.across * weight[:, None]).T @ self.across
        prior = np.clip(self.variance / scale**2, LEAST_RELATIVE, MOST_RELATIVE)
        root = np.sqrt(np.concatenate([np.ones(self.free), prior]))
        matrix = gram[:-1, :-1] * root * root[:, None]
        matrix.flat[(len(root) + 1) * self.free :: len(root) + 1] += 1.0
        # LAPACK itself: scipy's own functions look at their arguments for as long as this takes.
        factor, fault = dpotrf(matrix, lower=True, clean=False, overwrite_a=True)
        if fault:
            raise np.linalg.LinAlgError("products of columns that are not positive definite")
        towards, _ = dtrtrs(factor, root * gram[:-1, -1], lower=True)
        return float(
            self.freedom * 2.0 * np.log(scale)
            + np.log1p(relative * self.curvature).sum()
            + 2.0 * np.log(np.diag(factor)).sum()
            + max(float(gram[-1, -1] - towards @ towards), 0.0) / scale**2  # rounding leaves less
        )


def _clear_of_free(products: F64, free: I64, drift: I64, remaining: I64) -> tuple[int, F64]:
    """Rank of the columns *free*; products of *drift* and *remaining* columns, clear of these,
    where the products of the *remaining* among each other are only what is taken of them."""
    columns = np.concatenate([drift, remaining])
    root = _root_of_free(products[np.ix_(free, free)], np.diag(products)[free])
    towards = root.T @ products[np.ix_(free, columns)]
    cleared = -towards.T @ towards
    d = len(drift)
    cleared[:d] += products[np.ix_(drift, columns)]
    cleared[d:, d:] *= -1.0
    return root.shape[1], cleared


def _root_of_free(gram: F64, squared_norms: F64) -> F64:
    """(f, r) makes columns orthonormal by their products (f, f); a gauge among them leaves no
    trace. *squared_norms* (f,): their squared lengths before anything was eliminated."""
    size = np.sqrt(squared_norms)
    size[size == 0.0] = 1.0
    root: F64 = (
        compute_root_along_known(gram / np.outer(size, size), GAUGE_SQUARED, least_scale=1.0)
        / size[:, None]
    )
    return root

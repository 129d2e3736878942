"""The restricted likelihood of scale and drift, from sums of products.

It needs neither rows nor a large matrix. Columns that absorb freely in one session alone are
eliminated there. The drift's columns, which have one variance, are rotated until their products are
diagonal; the likelihood of any drift then costs one pass over them. The border remains: the columns
that all sessions share.
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
    """The b columns that absorb, by the part of the rows that they belong to."""

    per_part: tuple[I64, ...]  # columns of one part alone, free or of the drift
    shared: I64  # free columns that parts share
    with_prior: I64  # columns whose amplitudes have a prior
    drifting: Mask  # (b,)
    variance: F64  # (b,) of the amplitudes; inf: free, NaN: the drift's

    @classmethod
    def from_meeting(cls, meeting: Mask, variance: F64) -> Absorbing:
        """Group the columns by which of them are nonzero in a common row (b, b)."""
        drifting, free = np.isnan(variance), np.isinf(variance)
        inner = np.flatnonzero(drifting | free)
        parts = BorderedParts.from_matrix(meeting[np.ix_(inner, inner)])
        per_part, shared = [inner[part] for part in parts.inner_parts], inner[parts.border]
        if drifting[shared].any():
            per_part, shared = [inner], shared[:0]
        return cls(tuple(per_part), shared, np.flatnonzero(~(drifting | free)), drifting, variance)


@dataclass(frozen=True)
class Restricted:
    """Products of drift columns, other columns and residual, cleared of freely absorbing ones.

    There are d columns of the drift and k others, the *free* ones of these first and orthonormal.
    They are cleared of the columns that absorb freely in one part of the rows.
    """

    curvature: F64  # (d,) squared lengths of the drift's columns, orthogonal to each other
    across: F64  # (d, k + 1) products of them with the others and the residual
    gram: F64  # (k + 1, k + 1) products of the others and the residual
    variance: F64  # (k − free,) of the amplitudes that do not absorb freely
    free: int
    freedom: float  # rows less the rank of all that absorbs freely

    @classmethod
    def from_products(cls, products: F64, absorbing: Absorbing, rows: float) -> Restricted:
        """Make it from *products* (b + 1, b + 1) of whitened columns and a residual as the last.

        *rows*: the number of rows that were summed.
        """
        drifting, shared, with_prior = absorbing.drifting, absorbing.shared, absorbing.with_prior
        remaining = np.concatenate([shared, with_prior, [len(drifting)]])
        gram = products[np.ix_(remaining, remaining)]
        curvature, across, rank = [np.empty(0)], [np.empty((0, len(remaining)))], 0
        for part in absorbing.per_part:
            drift = drifting[part]
            r, cleared = _clear_of_free(products, part[~drift], part[drift], remaining)
            d = int(drift.sum())
            rank += r
            # A column that is absorbed entirely must not become negative by rounding.
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
        """The squared norm of the residual, cleared of all columns that absorb freely."""
        absorbed = self.gram[: self.free, -1]
        return float(self.gram[-1, -1] - absorbed @ absorbed)

    def negative_log_likelihood(self, scale: float, drift: float) -> float:
        """Return −2 × restricted log likelihood, up to a constant."""
        relative = np.clip(drift**2 / scale**2, LEAST_RELATIVE, MOST_RELATIVE)
        weight = relative / (1.0 + relative * self.curvature)
        gram = self.gram - (self.across * weight[:, None]).T @ self.across
        prior = np.clip(self.variance / scale**2, LEAST_RELATIVE, MOST_RELATIVE)
        root = np.sqrt(np.concatenate([np.ones(self.free), prior]))
        matrix = gram[:-1, :-1] * root * root[:, None]
        matrix.flat[(len(root) + 1) * self.free :: len(root) + 1] += 1.0
        # LAPACK itself: scipy's own functions check their arguments for as long as this takes.
        factor, fault = dpotrf(matrix, lower=True, clean=False, overwrite_a=True)
        if fault:
            raise np.linalg.LinAlgError("products of columns that are not positive definite")
        towards = root * gram[:-1, -1]
        if len(towards):  # LAPACK complains on stderr where there is nothing to solve
            towards, _ = dtrtrs(factor, towards, lower=True)
        return float(
            self.freedom * 2.0 * np.log(scale)
            + np.log1p(relative * self.curvature).sum()
            + 2.0 * np.log(np.diag(factor)).sum()
            + max(float(gram[-1, -1] - towards @ towards), 0.0) / scale**2  # rounding: below zero
        )


def _clear_of_free(products: F64, free: I64, drift: I64, remaining: I64) -> tuple[int, F64]:
    """Return the rank of *free* columns, and products of others cleared of them.

    The others are the *drift* and *remaining* columns. Products of the *remaining* among each other
    are only the part that the *free* columns take.
    """
    columns = np.concatenate([drift, remaining])
    root = _root_of_free(products[np.ix_(free, free)], np.diag(products)[free])
    towards = root.T @ products[np.ix_(free, columns)]
    cleared = -towards.T @ towards
    d = len(drift)
    cleared[:d] += products[np.ix_(drift, columns)]
    cleared[d:, d:] *= -1.0
    return root.shape[1], cleared


def _root_of_free(gram: F64, squared_norms: F64) -> F64:
    """Return a matrix (f, r) that makes columns orthonormal, from their products (f, f).

    A gauge among the columns is dropped. *squared_norms* (f,): the columns' squared lengths before
    any elimination.
    """
    size = np.sqrt(squared_norms)
    size[size == 0.0] = 1.0
    root: F64 = (
        compute_root_along_known(gram / np.outer(size, size), GAUGE_SQUARED, least_scale=1.0)
        / size[:, None]
    )
    return root

"""The likeness of two causes in the data at hand."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from armd.arrays import F64
from armd.compensation.diagnose.constants import ABSORBED, RIGHT_ANGLE_DEG
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.layout import name_block
from armd.compensation.diagnose.problem.signatures import make_finding_columns
from armd.compensation.effects.effect import Candidate
from armd.compensation.model.arm import Arm


@dataclass(frozen=True)
class Likeness:
    """A rival compared with a finding, both clear of all else in the model, in noise units."""

    angle_deg: float  # smallest principal angle of the signatures; 0: indistinguishable
    remaining_p: float  # significance of what the finding adds once the rival is in the model


def compute_likeness(
    candidate: Candidate, rivals: Sequence[Candidate], current: Fit, arm: Arm
) -> list[Likeness]:
    """Return the likeness of *candidate*, one of the fit's findings, with each of *rivals*."""
    block_name = name_block(current.findings.index(candidate))
    blocks = make_finding_columns(current.linear, [candidate, *rivals], arm)
    products = _products(np.hstack([current.residual[:, None], *blocks]), current, block_name)
    edges = np.cumsum([1, *(block.shape[1] for block in blocks)])
    mine, *of_rivals = (slice(low, high) for low, high in itertools.pairwise(edges))
    basis = _orthonormal(products, mine)
    likenesses = []
    for columns_of_rival in of_rivals:
        rival = _orthonormal(products, columns_of_rival)
        likenesses.append(
            Likeness(_angle(products, basis, rival), _remaining_p(products, mine, rival))
        )
    return likenesses


def _products(columns: F64, current: Fit, without: str) -> F64:
    """Return products (m, m) of *columns* (N, m), the residual and signatures, in the noise's
    metric.

    They are clear of what absorbs, except for the block *without*. What absorbs with a finite
    variance is noise that rests share: the metric is the inverse of the whole covariance, not a
    projection. Signatures are scaled to unit length before they are cleared.
    """
    white = current.noise.whiten(columns)
    size = np.sqrt((white**2).sum(axis=0))
    size[size == 0.0] = 1.0
    size[0] = 1.0  # the residual
    keep = current.layout.blocks.find_other_columns([without])
    absorbed = current.problem.only(keep).project(current.across(columns)[keep])
    products: F64 = (white.T @ white - absorbed.T @ absorbed) / np.outer(size, size)
    return products


def _orthonormal(products: F64, span: slice) -> F64:
    """Return combinations (m, r) of all columns that span those of *span*, orthonormal in
    *products*.
    """
    values, vectors = np.linalg.eigh(products[span, span])
    positive = values > ABSORBED
    basis = np.zeros((len(products), int(positive.sum())))
    basis[span] = vectors[:, positive] / np.sqrt(values[positive])
    return basis


def _remaining_p(products: F64, mine: slice, rival: F64) -> float:
    """Return the χ² tail of what *mine* explains of the residual (first column), given *rival*."""
    projector = np.eye(len(products)) - rival @ (rival.T @ products)
    remaining = projector.T @ products @ projector
    basis = _orthonormal(remaining, mine)
    if basis.shape[1] == 0:
        return 1.0
    return float(chdtrc(basis.shape[1], float(((basis.T @ remaining[:, 0]) ** 2).sum())))


def _angle(products: F64, a: F64, b: F64) -> float:
    if a.shape[1] == 0 or b.shape[1] == 0:
        return RIGHT_ANGLE_DEG
    largest = np.linalg.svd(a.T @ products @ b, compute_uv=False)[0]
    return float(np.degrees(np.arccos(min(float(largest), 1.0))))

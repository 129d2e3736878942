"""How alike two causes look to these data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import subspace_angles
from scipy.stats import chi2

from armd.compensation.arm import Arm
from armd.compensation.diagnose.evidence import inverse_factor
from armd.compensation.diagnose.fit import Fit, finding_columns
from armd.compensation.effects.effect import Candidate

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Likeness:
    """A rival beside a finding, both whitened and clear of all else in the model."""

    angle_deg: float  # smallest principal angle of the signatures; 0: not to be told apart
    left_p: float  # significance of what the finding adds once the rival is in the model


def compare(
    candidate: Candidate, rivals: Sequence[Candidate], current: Fit, arm: Arm
) -> list[Likeness]:
    """How alike *candidate*, one of the fit's findings, and each of *rivals* are."""
    own = current.layout.findings[current.findings.index(candidate)]
    blocks = finding_columns(current.linear, [candidate, *rivals], arm)
    clear = _cleared([current.residual[:, None], *blocks], current, own)
    residual, mine, *others = clear
    return [Likeness(_angle(mine, other), _left(residual[:, 0], mine, other)) for other in others]


def _cleared(blocks: Sequence[F64], current: Fit, without: slice) -> list[F64]:
    """Blocks of columns, whitened and projected clear of what absorbs but for *without*."""
    keep = np.ones(len(current.absorbing.variance), dtype=bool)
    keep[without] = False
    white, scale, gram = current.white
    ridge = 1.0 / (current.absorbing.variance[keep] * scale[keep] ** 2)
    factor = inverse_factor(gram[np.ix_(keep, keep)] + np.diag(ridge))
    signals = current.noise.whiten(np.hstack(blocks))
    across = white.T @ signals
    weights = np.zeros_like(across)
    weights[keep] = factor @ (factor.T @ across[keep])
    cleared = signals - white @ weights
    return np.split(cleared, np.cumsum([block.shape[1] for block in blocks])[:-1], axis=1)


def _left(residual: F64, mine: F64, other: F64) -> float:
    basis = _orthonormal(other)
    more = _orthonormal(mine - basis @ (basis.T @ mine), float(np.abs(mine).max(initial=0.0)))
    if more.shape[1] == 0:
        return 1.0
    return float(chi2.sf(float(((more.T @ residual) ** 2).sum()), more.shape[1]))


def _orthonormal(columns: F64, size: float | None = None) -> F64:
    """Basis of a span; directions far smaller than *size* (default: the columns') are nothing."""
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    largest = float(s.max(initial=0.0)) if size is None else size * np.sqrt(len(columns))
    basis: F64 = u[:, s > max(1e-4 * largest, 1e-300)]
    return basis


def _angle(a: F64, b: F64) -> float:
    if not (np.abs(a).max(initial=0.0) > 0.0 and np.abs(b).max(initial=0.0) > 0.0):
        return 90.0
    return float(np.degrees(subspace_angles(a, b).min()))

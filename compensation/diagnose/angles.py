"""How alike two causes look: the principal angle between their projected signatures."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.linalg import subspace_angles

from armd.compensation.arm import Arm
from armd.compensation.diagnose.evidence import inverse_factor
from armd.compensation.diagnose.fit import Fit, finding_columns
from armd.compensation.effects.effect import Candidate

F64 = npt.NDArray[np.float64]


def between(
    candidate: Candidate, rivals: Sequence[Candidate], current: Fit, arm: Arm
) -> list[float]:
    """Smallest principal angle in degrees between a finding and each rival, once whitened and
    clear of what absorbs (other findings not counted). 0: the data cannot tell them apart."""
    own, *others = (
        _projected(block, current)
        for block in finding_columns(current.linear, [candidate, *rivals], arm)
    )
    return [_angle(own, other) for other in others]


def _projected(columns: F64, current: Fit) -> F64:
    keep = np.ones(len(current.absorbing.variance), dtype=bool)
    for at in current.layout.findings:
        keep[at] = False
    white = current.noise.whiten(current.absorbing.columns[:, keep])
    scale = np.sqrt((white**2).sum(axis=0))
    scale[scale == 0.0] = 1.0
    white /= scale
    ridge = 1.0 / (current.absorbing.variance[keep] * scale**2)
    factor = inverse_factor(white.T @ white + np.diag(ridge))
    signal = current.noise.whiten(columns)
    clear: F64 = signal - white @ (factor @ (factor.T @ (white.T @ signal)))
    return clear


def _angle(a: F64, b: F64) -> float:
    if not (np.abs(a).max(initial=0.0) > 0.0 and np.abs(b).max(initial=0.0) > 0.0):
        return 90.0
    return float(np.degrees(subspace_angles(a, b).min()))

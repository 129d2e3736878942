"""Readings at the same angles: copies of one posture, which share the model's error there.

Measuring each pose three times gives as many postures as poses. The scatter of the copies is the
noise of a reading; the model's error at these angles is the same in all of them. If copies share a
part ρ of their error, m of them have the information of m / (1 + (m − 1) ρ) independent readings
(the design effect: L. Kish, Survey Sampling, 1965, section 5.4).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from armd.arrays import F64, I64

#: Angles no farther apart than this are the same: a robot returns within a tenth of it. An error of
#: the 20th order of a turn changes by 4 % over it.
SAME_RAD = 2e-3


def number_postures(q: F64, placement: I64, target: I64) -> I64:
    """Return the number (n,) of each reading's posture, from 0 in the order of the readings.

    *q* (n, N) rad. Copies are of one placement and of one *target* (n,), by number; -1 where the
    known point is not the artefact's.
    """
    n = len(q)
    finite = np.flatnonzero(np.isfinite(q).all(axis=1))
    if not len(finite):
        return np.arange(n)
    angles = np.concatenate([np.cos(q[finite]), np.sin(q[finite])], axis=1)
    pairs = KDTree(angles).query_pairs(SAME_RAD, p=np.inf, output_type="ndarray")
    first_rows, second_rows = finite[np.sort(pairs, axis=1)].T
    copies = (placement[first_rows] == placement[second_rows]) & (
        target[first_rows] == target[second_rows]
    )
    first_rows, second_rows = first_rows[copies], second_rows[copies]
    first = np.arange(n)
    for i, j in sorted(zip(first_rows.tolist(), second_rows.tolist(), strict=True)):
        if first[i] == i and first[j] == j:  # i is a first reading, j is no copy yet
            first[j] = i
    postures: I64 = np.unique(first, return_inverse=True)[1].reshape(n)
    return postures


def compute_counts(posture: I64, share: float) -> F64:
    """Return the weight (n,) of each reading, copies sharing their error to a part *share*."""
    copies: F64 = np.bincount(posture, minlength=1)[posture].astype(float)
    weight: F64 = 1.0 / (1.0 + (copies - 1.0) * share)
    return weight


def estimate_shared_part(white: F64, posture: I64, components: I64 | int = 3) -> float:
    """Return the part of their error that copies share, from residuals (n, 3) of unit variance.

    *components* (n,): the number of each residual's components: 3, or 1 on a surface.

    Differences between copies have a variance of one less that part. Without copies the part is 1:
    the careful answer where readings do not show it, and without effect.
    """
    copies = np.bincount(posture, minlength=1)
    freedom = int((components * (1.0 - 1.0 / copies[posture])).sum().round())
    if not freedom:
        return 1.0
    sums = np.stack([np.bincount(posture, column) for column in white.T], axis=1)
    deviation = white - (sums / copies[:, None])[posture]
    return float(np.clip(1.0 - (deviation**2).sum() / freedom, 0.0, 1.0))

"""Which readings far off are no outliers: those that stand among their like.

An outlier is one reading gone wrong: its neighbours in posture are right. Where these are as far
off, the arm is wrong in a whole region of postures (a run-out, a stop touched, a link that
gives), and there as much as elsewhere the constants have to serve: weighed down, the region would
be left to itself and the constants made for the rest, worse over all than plain least squares.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from armd.arrays import F64, Mask

#: A reading far off is of a region if half of so many nearest readings are far off, too: nearest
#: in posture, or in the angle of one joint. Of readings gone wrong at random, one in ten of all,
#: one in 300 is taken for that; with 8 or 16 regions are found as well.
NEIGHBOURS = 12
#: Postures closer than this are one posture: what went wrong there once may have stood there.
SAME_POSTURE_RAD = 0.01


def find_regions(is_far: Mask, q: F64) -> Mask:
    """(n,) which of the readings far off, *is_far*, stand among their like; angles *q* (n, N)
    rad."""
    region = np.zeros_like(is_far)
    rows = np.flatnonzero(is_far)
    if len(rows) < NEIGHBOURS / 2:
        return region
    turned = np.stack([np.cos(q), np.sin(q)], axis=2)
    for places in (turned.reshape(len(q), -1), *np.moveaxis(turned, 1, 0)):
        # Of postures read several times, one stands for all: more are asked for than counted.
        nearest = np.asarray(KDTree(places).query(places[rows], min(4 * NEIGHBOURS, len(q)))[1])
        for row, neighbours in zip(rows, nearest, strict=True):
            distance_rad = np.abs(turned[neighbours] - turned[row]).max(axis=(1, 2))
            counted = neighbours[distance_rad > SAME_POSTURE_RAD][:NEIGHBOURS]
            region[row] |= len(counted) > 0 and is_far[counted].mean() >= 0.5
    return region

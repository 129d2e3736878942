"""Regions of postures in which many readings are far off, and which are no outliers.

An outlier is one wrong reading among neighbours in posture that are right. If its neighbours are
far off, too, the arm is wrong in a whole region of postures (a run-out, a stop touched, a link that
gives), and the constants have to serve there as elsewhere. If such a region were down-weighted, the
constants would fit the other postures only, and be worse over all than plain least squares.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from armd.arrays import F64, Mask

#: A reading far off is of a region if half of so many nearest readings are far off, too: nearest
#: in posture, or in the angle of one joint. If one in ten readings is wrong at random, one in 300
#: of these is taken for a region. With 8 or 16 neighbours, regions are found as well.
NEIGHBOURS = 12
#: Postures closer than this are one posture: one fault may affect all its readings.
SAME_POSTURE_RAD = 0.01


def find_regions(is_far: Mask, q: F64) -> Mask:
    """Find which (n,) of the readings far off, *is_far*, have many others among their neighbours.

    *q* (n, N) rad: their angles.
    """
    region = np.zeros_like(is_far)
    rows = np.flatnonzero(is_far)
    if len(rows) < NEIGHBOURS / 2:
        return region
    turned = np.stack([np.cos(q), np.sin(q)], axis=2)
    for places in (turned.reshape(len(q), -1), *np.moveaxis(turned, 1, 0)):
        # Copies of the reading's own posture are skipped: more are requested than counted.
        nearest = np.asarray(KDTree(places).query(places[rows], min(4 * NEIGHBOURS, len(q)))[1])
        for row, neighbours in zip(rows, nearest, strict=True):
            distance_rad = np.abs(turned[neighbours] - turned[row]).max(axis=(1, 2))
            counted = neighbours[distance_rad > SAME_POSTURE_RAD][:NEIGHBOURS]
            region[row] |= len(counted) > 0 and is_far[counted].mean() >= 0.5
    return region

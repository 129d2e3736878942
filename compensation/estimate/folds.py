"""Which readings are left out together."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.estimate.observations import Observations

MOST_FOLDS = 8


def whole_groups(labels: I64, most: int) -> I64:
    """Fold (n,) of each reading: groups of one label (n,) stay whole, dealt in turn to *most*."""
    names, group = np.unique(labels, return_inverse=True)
    folds: I64 = group % max(min(len(names), most), 1)
    return folds


def blocks_of_time(time_s: F64, blocks: int) -> I64:
    """Fold (n,) of each reading: so many runs of readings, one after another."""
    order = np.argsort(np.argsort(time_s, kind="stable"), kind="stable")
    folds: I64 = order * blocks // max(len(order), 1)
    return folds


def blocks_of_postures(observations: Observations, blocks: int) -> I64:
    """Return the fold (n,) of each reading: so many runs of postures, by when each came first."""
    posture = observations.posture
    first = np.unique(posture, return_index=True)[1]
    folds: I64 = blocks_of_time(observations.states.time_s[first], blocks)[posture]
    return folds


def placement_folds(observations: Observations, most: int = MOST_FOLDS) -> tuple[list[Mask], str]:
    """Return at *most* so many sets of whole placements to leave out, and what they are.

    With one placement only, every *most*-th posture is left out instead, with all its copies, at
    the pose that the others tell: weaker, and said so.
    """
    fold, by = whole_groups(observations.placement, most), "placement"
    if not fold.any():
        posture = observations.posture
        repeated = len(posture) > len(np.unique(posture))
        fold, by = posture % most, "posture" if repeated else "reading"
    return [fold == i for i in np.unique(fold)], by

"""The folds of readings that are held out together."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.estimate.observations import Observations

MOST_FOLDS = 8


def assign_group_folds(labels: I64, max_folds: int) -> I64:
    """Return the fold (n,) of each reading, at most *max_folds*; one label has one fold."""
    names, group = np.unique(labels, return_inverse=True)
    folds: I64 = group % max(min(len(names), max_folds), 1)
    return folds


def assign_time_folds(time_s: F64, blocks: int) -> I64:
    """Return the fold (n,) of each reading: so many *blocks* of readings that follow each other."""
    order = np.argsort(np.argsort(time_s, kind="stable"), kind="stable")
    folds: I64 = order * blocks // max(len(order), 1)
    return folds


def assign_posture_folds(observations: Observations, blocks: int) -> I64:
    """Return the fold (n,) of each reading: *blocks* of postures, ordered by first reading."""
    posture = observations.posture
    first = np.unique(posture, return_index=True)[1]
    folds: I64 = assign_time_folds(observations.states.time_s[first], blocks)[posture]
    return folds


def make_placement_folds(
    observations: Observations, max_folds: int = MOST_FOLDS
) -> tuple[list[Mask], str]:
    """Return at most *max_folds* sets of whole placements to hold out, and what they are.

    With one placement only, every *max_folds*-th posture is held out, with all its copies, at the
    pose that the others give. That is a weaker test, and reported as such.
    """
    fold, by = assign_group_folds(observations.placement, max_folds), "placement"
    if not fold.any():
        posture = observations.posture
        repeated = len(posture) > len(np.unique(posture))
        fold, by = posture % max_folds, "posture" if repeated else "reading"
    return [fold == i for i in np.unique(fold)], by

"""What is known of a candidate's amplitudes before any reading."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import MOST_FREE_COLUMNS
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import SCALES, Candidate, Column


def is_sized(candidate: Candidate) -> bool:
    """Whether it is a nearly free function, its amplitudes held together by one likely size."""
    own_shape = candidate.location.kind == "shape"
    return len(candidate.columns) > MOST_FREE_COLUMNS and not own_shape


def is_curve(candidate: Candidate) -> bool:
    """Whether it is such a function over the turn of one joint."""
    return CATALOGUE[candidate.cause].describe_curve is not None and is_sized(candidate)


def most_plausible(column: Column) -> float:
    """Standard deviation of an amplitude under the broadest prior that the catalogue has for it."""
    return min(max(SCALES), column.reach) * column.prior_sd


def amplitude_variance(candidate: Candidate, size: float) -> F64:
    """A named cause's amplitudes are as large as they can be, those without a name free; a nearly
    free function's are of a size in units of the catalogue's.

    Where the readings tell the amplitudes, that changes nothing; where several do the same, they
    share it rather than stand against each other, a thousand times what they could be.
    """
    if not is_sized(candidate):
        if candidate.cause == "unknown":
            return np.full(len(candidate.columns), np.inf)
        return np.square([most_plausible(column) for column in candidate.columns])
    return np.array([(size * column.prior_sd) ** 2 for column in candidate.columns])

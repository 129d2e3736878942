"""The prior of a candidate's amplitudes, before any reading."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import MOST_FREE_COLUMNS
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import Candidate
from armd.compensation.effects.sizes import compute_broadest_sd


def is_sized(candidate: Candidate) -> bool:
    """Return whether a candidate is a nearly free function, its amplitudes of one likely size."""
    own_shape = candidate.location.kind == "shape"
    return len(candidate.columns) > MOST_FREE_COLUMNS and not own_shape


def is_curve(candidate: Candidate) -> bool:
    """Return whether a candidate is a nearly free function over the turn of one joint."""
    return CATALOGUE[candidate.cause].describe_curve is not None and is_sized(candidate)


def compute_amplitude_variance(candidate: Candidate, size: float) -> F64:
    """Return the prior variance (m,) of each amplitude of a candidate.

    A named cause has the variance of its broadest prior, an unnamed one infinity. A nearly free
    function has *size* times the catalogue's standard deviation. Where the readings determine the
    amplitudes, these variances change nothing. Where several amplitudes have the same effect, the
    variances make them share it. Without variances they would cancel each other at a thousand times
    their plausible size.
    """
    if not is_sized(candidate):
        if candidate.cause == "unknown":
            return np.full(len(candidate.columns), np.inf)
        return np.square([compute_broadest_sd(column) for column in candidate.columns])
    return np.array([(size * column.prior_sd) ** 2 for column in candidate.columns])

"""The prior of a cause's size: how many times its typical size its amplitudes may be.

An amplitude is normal about zero. Its standard deviation is a scale times the catalogue's typical
size (`Column.prior_sd`). The scale is about log-uniform, smaller ones being likelier, and is cut at
the largest plausible size (`Column.reach`). One candidate's evidence, the posterior of a set and
the fit use this one prior.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from armd.arrays import F64
from armd.compensation.effects.effect import Column

#: The scales, with their prior probabilities.
SCALES = {1.0: 0.6, 5.0: 0.3, 50.0: 0.1}


def list_sizes(prior_sd: F64, reach: F64) -> Iterator[tuple[float, F64]]:
    """Yield each scale's log prior probability, and the standard deviations of amplitudes at it.

    *prior_sd*, *reach* and the standard deviations have the same shape, one value per amplitude.
    """
    for scale, share in SCALES.items():
        yield math.log(share), np.minimum(scale, reach) * prior_sd


def compute_broadest_sd(column: Column) -> float:
    """Return an amplitude's standard deviation at the largest scale."""
    return min(max(SCALES), column.reach) * column.prior_sd

"""The threshold above which a score is too high for noise, given the number of tests."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64, Mask
from armd.compensation.diagnose.constants import ALPHA, BELOW_ONE


def compute_family_wise_p(log_p: F64 | float, tests: int) -> F64:
    """Return the probability that the smallest of *tests* p values falls below exp(log_p) by
    chance.

    This is Bonferroni's count (in Šidák's form), although signatures are alike. In 3000 simulated
    data sets of the standard design, the 3200 candidates correspond to 1700 independent ones at the
    median. At the 1 % level, where the threshold is, they correspond to 3000. A count taken at the
    median lets 1.7 % through. Tails of Student's t with 4 degrees of freedom, winsorised, do not
    change this.
    """
    return np.asarray(-np.expm1(tests * np.log1p(-np.minimum(np.exp(log_p), 1.0 - BELOW_ONE))))


def is_significant(log_p: F64 | float, tests: int) -> Mask:
    """Whether noise reaches a p value only once in a hundred data sets."""
    return compute_family_wise_p(log_p, tests) < ALPHA

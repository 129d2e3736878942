"""Fits of an arm's constants to what was observed, in one thread."""

from __future__ import annotations

from collections.abc import Sequence

from threadpoolctl import threadpool_limits

from armd.compensation.estimate.gauge import list_free_constants
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.fit import Identification, fit
from armd.compensation.model.terms import Term


def fit_constants(observations: Observations, terms: Sequence[Term] = ()) -> Identification:
    """From the drawing, with the coefficients of *terms*."""
    arm = observations.arm
    unknowns = Unknowns(list_free_constants(arm), range(len(terms)))
    with threadpool_limits(limits=1, user_api="blas"):
        return fit(observations, arm.nominal(), [*terms], unknowns, arm.reference_temperature_c)

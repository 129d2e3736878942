"""Linear expansion of the links, where the model under test has no thermal model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.problem.linear import Baseline, Linear
from armd.compensation.effects.thermal.link_expansion import EXPANSION_PER_K
from armd.compensation.identify.thermal.terms import make_length_terms
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values
from armd.compensation.model.parameters import LEAST_LENGTH_MM
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term


def make_expansion_columns(linear: Linear, baseline: Baseline, arm: Arm) -> tuple[F64, F64]:
    """Return columns (N, m) of every length's expansion per kelvin, and variances (m,) in mm²/K².

    There is none under a given calibration, or beside a thermal model.

    A link's expansion is linear in temperature before any curve of it shows, and a calibration made
    from the readings would identify it. Where the temperatures span too little for that, linear
    expansion is no cause to report (docs/decisions/0029). It is taken about the mean temperature,
    so that the constants stay those of a calibration without a thermal model.
    """
    with_growth = baseline.is_given or has_thermal_model(baseline.model.terms)
    terms = [] if with_growth else make_length_terms(arm, [1])
    if not terms:
        return np.zeros((len(linear.residual), 0)), np.zeros(0)
    states, model = linear.rests.observations.states, linear.model
    rise = compute_basis_values(terms, states, arm, model.reference_c, model.constants)
    finite = np.isfinite(rise)
    mean = np.where(finite, rise, 0.0).sum(axis=0) / np.maximum(finite.sum(axis=0), 1)
    rise = np.where(finite, rise - mean, 0.0)
    places = arm.layout.indices(term.parameter for term in terms)
    columns = [linear.signature(p, values) for p, values in zip(places, rise.T, strict=True)]
    return np.array(columns).T, compute_growth_mm_per_k(model.constants, places) ** 2


def has_thermal_model(terms: Iterable[Term]) -> bool:
    """Return whether there is a thermal model among *terms*."""
    return any(isinstance(factor, Temperature) for term in terms for factor in term.basis)


def compute_growth_mm_per_k(constants: F64, places: Sequence[int]) -> F64:
    """Return by how much (m,) the lengths at *places* of the *constants* may grow, a priori."""
    growth_mm: F64 = EXPANSION_PER_K * np.maximum(np.abs(constants[places]), LEAST_LENGTH_MM)
    return growth_mm

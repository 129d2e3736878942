"""The thermal expansion of each length, which a calibration at one temperature leaves unknown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.fitting.expansions import (
    compute_growth_mm_per_k,
    has_thermal_model,
)
from armd.compensation.identify.thermal.temperatures import MOST_SPAN_K
from armd.compensation.identify.thermal.terms import make_growth_terms, make_length_terms
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term

#: The names of growths among the known errors begin with this (`Reduced.known_names`).
GROWTH = "growth "


@dataclass(frozen=True)
class OpenGrowth:
    """A length whose expansion with temperature is unknown."""

    term: Term  # its coefficient is 0
    made_k: float  # middle of the calibration's temperatures, above the reference
    size: float  # prior standard deviation, mm per kelvin

    @property
    def name(self) -> str:
        return f"{GROWTH}{self.term.parameter}"


def list_open_growth(arm: Arm, calibration: Calibration) -> tuple[OpenGrowth, ...]:
    """List the expansion of every length, if *calibration* leaves it unknown.

    It does if it has no thermal term and was made over at most `MOST_SPAN_K`, of temperatures that
    the arm's sensors in use measured. Otherwise the list is empty.
    """
    ranges = calibration.temperature_range_c
    if has_thermal_model(calibration.terms) or not arm.used_sensors:
        return ()
    if not set(arm.used_sensors) <= set(ranges):
        return ()
    if max(high - low for low, high in ranges.values()) > MOST_SPAN_K:
        return ()
    terms = [t.model_copy(update={"coefficient": 0.0})
             for t in (*make_growth_terms(arm), *make_length_terms(arm, [1]))]  # fmt: skip
    places = arm.layout.indices(term.parameter for term in terms)
    sizes = compute_growth_mm_per_k(calibration.vector(arm.n_joints), places)
    return tuple(
        OpenGrowth(term, _compute_middle_k(term, calibration), float(size))
        for term, size in zip(terms, sizes, strict=True)
    )


def _compute_middle_k(term: Term, calibration: Calibration) -> float:
    (factor,) = term.basis
    assert isinstance(factor, Temperature)
    return sum(
        weight * (sum(calibration.temperature_range_c[name]) / 2)
        for name, weight in factor.weights.items()
    ) - calibration.reference_temperature_c * sum(factor.weights.values())


def compute_rises_k(
    growth: Sequence[OpenGrowth], states: States, arm: Arm, calibration: Calibration
) -> F64:
    """Return how much warmer each length was than at its calibration (n, m), K.

    A missing temperature is replaced by the mean of the others.
    """
    constants = calibration.vector(arm.n_joints)
    reference_c = calibration.reference_temperature_c
    warm = compute_basis_values(
        [expansion.term for expansion in growth], states, arm, reference_c, constants
    )
    rise: F64 = warm - np.array([expansion.made_k for expansion in growth])
    is_finite = np.isfinite(rise)
    mean = np.where(is_finite, rise, 0.0).sum(axis=0) / np.maximum(is_finite.sum(axis=0), 1)
    return np.where(is_finite, rise, mean)

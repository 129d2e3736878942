"""What a calibration made at one temperature does not know: how lengths grow."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.fitting.expansions import goes_with_temperature, growth_mm_per_k
from armd.compensation.diagnose.problem.linear import Baseline
from armd.compensation.identify.thermal.temperatures import MOST_SPAN_K
from armd.compensation.identify.thermal.terms import length_terms
from armd.compensation.model.arm import Arm
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.wording import plain


def with_growth_open(baseline: Baseline, arm: Arm) -> Baseline:
    """A given calibration whose every length grows by 0 ± `growth_mm_per_k`, about the
    middle of the temperatures that it was made at, if it could not tell any growth; otherwise as
    it is.

    Each link does grow. What of that a warmer or colder session shows is what the calibration
    leaves open, as uncertain constants are, and no cause (docs/decisions/0133).
    """
    if not could_not_tell_growth(baseline, arm):
        return baseline
    model, ranges = baseline.model, baseline.calibration.temperature_range_c
    terms = [t.model_copy(update={"coefficient": 0.0}) for t in length_terms(arm, [1])]
    places = arm.layout.indices(term.parameter for term in terms)
    growth = growth_mm_per_k(model.constants, places)
    identified = len(baseline.parameters)
    n, root = identified + len(baseline.terms), baseline.root
    moves: F64 = np.zeros((n + len(terms), len(terms)))
    for j, (term, place, per_k) in enumerate(zip(terms, places, growth, strict=True)):
        (factor,) = term.basis
        assert isinstance(factor, Temperature)
        made_k = sum(
            weight * (sum(ranges[name]) / 2 - model.reference_c)
            for name, weight in factor.weights.items()
        )
        moves[n + j, j] = per_k
        if place in baseline.parameters:  # so long it was where it was calibrated
            moves[baseline.parameters.index(place), j] = -per_k * made_k
    padded = np.vstack([root, np.zeros((len(terms), root.shape[1]))])
    first = len(model.terms)
    return replace(
        baseline,
        model=replace(model, terms=(*model.terms, *terms)),
        terms=(*baseline.terms, *range(first, first + len(terms))),
        root=np.hstack([padded, moves]),
    )


def could_not_tell_growth(baseline: Baseline, arm: Arm) -> bool:
    """Whether a given calibration has no thermal term, and all its temperatures lay as close as
    one: it was made of nothing that could show one."""
    known = goes_with_temperature(baseline.calibration.terms)
    if not baseline.held or not arm.used_sensors or known:
        return False
    ranges = baseline.calibration.temperature_range_c
    return set(arm.used_sensors) <= set(ranges) and _widest_k(baseline) <= MOST_SPAN_K


def told_of_growth(baseline: Baseline, arm: Arm) -> list[str]:
    """What a person should know of such a calibration; nothing of another."""
    if not could_not_tell_growth(baseline, arm):
        return []
    return [
        f"The calibration was made within {plain(_widest_k(baseline))} K and does not know how the "
        "links grow: what they may do by other temperatures is left open. Calibrate with sessions "
        f"more than {MOST_SPAN_K:g} K apart."
    ]


def _widest_k(baseline: Baseline) -> float:
    """How far the temperatures of one sensor lay apart, of those that a calibration was made at."""
    ranges = baseline.calibration.temperature_range_c.values()
    return max((high - low for low, high in ranges), default=0.0)

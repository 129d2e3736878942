"""What a calibration of one temperature, or of large errors, does not know: how lengths grow."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.fitting.expansions import goes_with_temperature, growth_mm_per_k
from armd.compensation.diagnose.problem.linear import Baseline
from armd.compensation.identify.thermal.temperatures import MOST_SPAN_K
from armd.compensation.identify.thermal.terms import length_terms
from armd.compensation.model.arm import Arm
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from armd.compensation.wording import plain

#: What readings left out of a calibration missed by is in its provenance by this name.
LEFT_UM = "heldout_without_outliers_um"
#: Growth that makes less than so many times what is left does not stand out of it: of a disc far
#: off its axis 22 µm were left, growth would have made 22, and what there was of it, 13, was not
#: worth a term.
STANDS_OUT = 2.0


def with_growth_open(baseline: Baseline, arm: Arm) -> Baseline:
    """A given calibration whose every length grows by 0 ± `growth_mm_per_k`, about the
    middle of the temperatures that it was made at, if it could not tell any growth; otherwise as
    it is.

    Each link does grow. What of that a warmer or colder session shows is what the calibration
    leaves open, as uncertain constants are, and no cause (docs/decisions/0133).
    """
    if not could_not_tell_growth(baseline, arm):
        return baseline
    model = baseline.model
    terms = [t.model_copy(update={"coefficient": 0.0}) for t in length_terms(arm, [1])]
    places = _places(terms, arm)
    growth = growth_mm_per_k(model.constants, places)
    identified = len(baseline.parameters)
    n, root = identified + len(baseline.terms), baseline.root
    moves: F64 = np.zeros((n + len(terms), len(terms)))
    for j, (term, place, per_k) in enumerate(zip(terms, places, growth, strict=True)):
        made_k = sum(
            weight * (sum(range_c) / 2 - model.reference_c)
            for weight, range_c in _weighted(baseline, term)
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
    """Whether a given calibration has no thermal term, and could not have: all its temperatures lay
    as close as one, or what was left of its readings hides what they make."""
    known = goes_with_temperature(baseline.calibration.terms)
    if not baseline.held or not arm.used_sensors or known:
        return False
    if not set(arm.used_sensors) <= set(baseline.calibration.temperature_range_c):
        return False
    return _widest_k(baseline) <= MOST_SPAN_K or _hidden(baseline, arm)


def told_of_growth(baseline: Baseline, arm: Arm) -> list[str]:
    """What a person should know of such a calibration; nothing of another."""
    if not could_not_tell_growth(baseline, arm):
        return []
    open_now = "does not know how the links grow: what they may do by other temperatures is left"
    if _widest_k(baseline) <= MOST_SPAN_K:
        return [
            f"The calibration was made within {plain(_widest_k(baseline))} K and {open_now} open. "
            f"Calibrate with sessions more than {MOST_SPAN_K:g} K apart."
        ]
    left_um = baseline.calibration.provenance[LEFT_UM]
    return [
        f"The calibration missed its own readings by {plain(left_um)} µm and {open_now} open. "
        "Calibrate again when what is found has been mended."
    ]


def _hidden(baseline: Baseline, arm: Arm) -> bool:
    """Whether growth would not have stood out of what a calibration left of its readings."""
    left_um = baseline.calibration.provenance.get(LEFT_UM)
    if not isinstance(left_um, int | float):
        return False
    terms = length_terms(arm, [1])
    growth = growth_mm_per_k(baseline.model.constants, _places(terms, arm))
    spans = [
        sum(weight * (high - low) for weight, (low, high) in _weighted(baseline, term))
        for term in terms
    ]
    makes_mm = math.hypot(*(growth * np.array(spans))) / math.sqrt(12.0)  # spread evenly
    return makes_mm < STANDS_OUT * 1e-3 * left_um


def _places(terms: Sequence[Term], arm: Arm) -> list[int]:
    return arm.layout.indices(term.parameter for term in terms)


def _weighted(baseline: Baseline, term: Term) -> list[tuple[float, tuple[float, float]]]:
    """The weight of each of a term's sensors, and from where to where it read."""
    (factor,) = term.basis
    assert isinstance(factor, Temperature)
    ranges = baseline.calibration.temperature_range_c
    return [(weight, ranges[name]) for name, weight in factor.weights.items()]


def _widest_k(baseline: Baseline) -> float:
    """How far the temperatures of one sensor lay apart, of those that a calibration was made at."""
    ranges = baseline.calibration.temperature_range_c.values()
    return max((high - low for low, high in ranges), default=0.0)

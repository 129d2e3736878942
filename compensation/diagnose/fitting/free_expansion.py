"""Free expansion of links: growth with temperature that a given calibration could not know.

Each link grows with temperature. A calibration made at one temperature has no term for that, nor
has one whose own errors hid it. So each length without a thermal term grows by 0 ± 20·10⁻⁶ per
kelvin about the middle of the temperatures at which the calibration was made. If only some sensors
changed their temperature, a calibration may still have a coefficient for every length. For a length
whose own sensors did not change, that coefficient is known only as well as its covariance says.
Free expansion is one more way in which the calibration may be wrong, and counts against every cause
alike. Expansion that the readings show is named after all else is found.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from armd.arrays import F64
from armd.compensation.diagnose.constants import EVENLY, STANDS_OUT
from armd.compensation.diagnose.fitting.expansions import (
    compute_growth_mm_per_k,
    has_thermal_model,
)
from armd.compensation.diagnose.problem.baseline import compute_root
from armd.compensation.diagnose.problem.linear import Baseline
from armd.compensation.identify.thermal.temperatures import MOST_SPAN_K
from armd.compensation.identify.thermal.terms import make_length_terms
from armd.compensation.model.arm import Arm
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from armd.compensation.wording import format_plain

#: Key in a calibration's provenance: error on held-out readings without outliers, µm.
HELDOUT_UM = "heldout_without_outliers_um"


def open_growth(baseline: Baseline, arm: Arm) -> Baseline:
    """Give the lengths of a given calibration free expansion, where it could not know their growth.

    Lengths without a thermal term get a term that is zero with the uncertainty of materials.
    Coefficients of lengths whose sensors stayed at one temperature are marked as open, too. The
    baseline is returned as it is where there is no such length, or where the calibration lacks the
    temperatures of a sensor.
    """
    if not baseline.is_given:
        return baseline
    if guessed := _list_guessed(baseline, arm):
        baseline = replace(baseline, growth=guessed)
    terms = _without_a_term(baseline, arm)
    if not terms:
        return baseline
    model = baseline.model
    places = arm.layout.indices(term.parameter for term in terms)
    may_grow = compute_growth_mm_per_k(model.constants, places)
    if not _could_not_know(baseline, terms, may_grow):
        return baseline
    terms = [_from_where_it_was_made(baseline, term) for term in terms]
    first = len(model.terms)
    growth = tuple(range(first, first + len(terms)))
    return replace(
        baseline,
        model=replace(model, terms=(*model.terms, *terms)),
        terms=(*baseline.terms, *growth),
        root=block_diag(baseline.root, np.diag(may_grow)),
        growth=(*baseline.growth, *growth),
    )


def _list_guessed(baseline: Baseline, arm: Arm) -> tuple[int, ...]:
    """List the calibration's own terms of growth whose sensors stayed at one temperature."""
    terms, ranges = baseline.model.terms, baseline.calibration.temperature_range_c
    growing = {term.parameter for term in make_length_terms(arm, [1])}
    thermal = Counter(term.parameter for term in terms if has_thermal_model([term]))
    return tuple(
        i
        for i in baseline.terms
        if terms[i].parameter in growing
        and thermal[terms[i].parameter] == 1
        and _is_plain(terms[i], ranges)
        and max(high - low for _, (low, high) in _weighted(baseline, terms[i])) <= MOST_SPAN_K
    )


def _is_plain(term: Term, ranges: Mapping[str, tuple[float, float]]) -> bool:
    """Return whether a term is first-order in temperatures whose ranges the calibration has."""
    return len(term.basis) == 1 and all(
        isinstance(factor, Temperature)
        and factor.order == 1
        and not factor.lag_s
        and not factor.zone_c
        and set(factor.weights) <= set(ranges)
        for factor in term.basis
    )


def drop_growth(baseline: Baseline, parameters: Collection[str] | None = None) -> Baseline:
    """Return the baseline without free expansion of these *parameters*, or of any.

    The covariance of the others is conditioned on this expansion being zero.
    """
    terms = baseline.model.terms
    still = {i for i in baseline.growth if parameters is None or terms[i].parameter in parameters}
    if not still:
        return baseline
    first = len(baseline.parameters)
    rows = [first + k for k, i in enumerate(baseline.terms) if i in still]
    remaining_rows = np.setdiff1d(np.arange(len(baseline.root)), rows)
    # Directions of the root in which these parameters do not grow.
    _, sizes, directions = np.linalg.svd(baseline.root[rows])
    remaining_root = baseline.root[remaining_rows] @ directions[int((sizes > 0.0).sum()) :].T
    # The calibration's own terms stay, with their coefficients.
    n_own = len(baseline.calibration.terms)
    remaining_terms = [i for i in range(len(terms)) if i not in still or i < n_own]
    return replace(
        baseline,
        model=replace(baseline.model, terms=tuple(terms[i] for i in remaining_terms)),
        terms=tuple(remaining_terms.index(i) for i in baseline.terms if i not in still),
        root=compute_root(remaining_root @ remaining_root.T),
        growth=tuple(remaining_terms.index(i) for i in baseline.growth if i not in still),
    )


def _from_where_it_was_made(baseline: Baseline, term: Term) -> Term:
    """Return the term about the middle of the calibration's temperatures, with coefficient zero.

    There all lengths are as the calibration has them.
    """
    (factor,) = term.basis
    made_c = sum(weight * sum(range_c) / 2 for weight, range_c in _weighted(baseline, term))
    about = factor.model_copy(update={"reference_c": made_c})
    return term.model_copy(update={"coefficient": 0.0, "basis": [about]})


def report_growth(baseline: Baseline) -> list[str]:
    """Return remarks on such a calibration, where the readings show no growth."""
    if not baseline.growth:
        return []
    return [
        f"{explain_missing_growth(baseline)} No growth of a link stands out of these readings; "
        f"what stays within their noise is left open. "
        f"Calibrate with sessions more than {MOST_SPAN_K:g} K apart."
    ]


def explain_missing_growth(baseline: Baseline) -> str:
    """Explain in a sentence why a calibration could not know the growth that is open."""
    within, n_own = _widest_k(baseline), len(baseline.calibration.terms)
    guessed = [baseline.model.terms[i] for i in baseline.growth if i < n_own]
    if guessed:
        spans = [high - low for term in guessed for _, (low, high) in _weighted(baseline, term)]
        return (
            f"The calibration's thermal model was made within {format_plain(max(spans))} K for "
            f"{', '.join(term.parameter for term in guessed)}, too little to know their growth."
        )
    if within <= MOST_SPAN_K:
        reason = f"was made within {format_plain(within)} K"
    else:
        residual_um = format_plain(baseline.calibration.provenance[HELDOUT_UM])
        reason = f"missed its own readings by {residual_um} µm"
    return f"The calibration {reason} and has no thermal model of all links."


def _without_a_term(baseline: Baseline, arm: Arm) -> list[Term]:
    """List the terms of growth of those lengths for which the calibration has none."""
    modelled = {t.parameter for t in baseline.model.terms if has_thermal_model([t])}
    ranges = baseline.calibration.temperature_range_c
    if not arm.used_sensors or not set(arm.used_sensors) <= set(ranges):
        return []
    return [term for term in make_length_terms(arm, [1]) if term.parameter not in modelled]


def _could_not_know(baseline: Baseline, terms: Sequence[Term], may_grow: F64) -> bool:
    """Return whether a calibration's temperatures or its error left the lengths' growth unknown.

    Either all its temperatures were nearly the same, or its held-out error hides the growth.
    """
    if _widest_k(baseline) <= MOST_SPAN_K:
        return True
    heldout_um = baseline.calibration.provenance.get(HELDOUT_UM)
    if not isinstance(heldout_um, int | float):
        return False
    spans = [
        sum(weight * (high - low) for weight, (low, high) in _weighted(baseline, term))
        for term in terms
    ]
    makes_mm = EVENLY * math.hypot(*(may_grow * np.array(spans)))
    return makes_mm < STANDS_OUT * 1e-3 * heldout_um


def _weighted(baseline: Baseline, term: Term) -> list[tuple[float, tuple[float, float]]]:
    """Return the weight of each of a term's sensors, and the range that it read."""
    (factor,) = term.basis
    assert isinstance(factor, Temperature)
    ranges = baseline.calibration.temperature_range_c
    return [(weight, ranges[name]) for name, weight in factor.weights.items()]


def _widest_k(baseline: Baseline) -> float:
    """Return the widest range of one sensor's temperatures in the calibration."""
    ranges = baseline.calibration.temperature_range_c.values()
    return max((high - low for low, high in ranges), default=0.0)

"""Causes that were there when the calibration under test was made.

An arm whose joint turns with temperature did so while it was calibrated. What its constants (and
the powers of that temperature which the calibration has) could absorb at those temperatures, they
did. What is left is the cause's course less that: at the calibration's only temperature nothing,
wherever the reference temperature is. The same holds of what has no name and goes by temperature.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from armd.arrays import F64
from armd.compensation.effects.effect import Candidate, Column, SessionFacts
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term

#: Added to a column's name.
OLDER = "beyond the calibration"


def drop_absorbed(candidate: Candidate, facts: SessionFacts) -> Candidate | None:
    """The cause less what the calibration under test has absorbed of it; None where that is
    nothing (no calibration is given), or all of it."""
    if not facts.calibrated_c or candidate.refine is not None:
        return None
    columns = [_beyond(column, facts) for column in candidate.columns]
    if any(column is None for column in columns):
        return None
    return replace(candidate, columns=tuple(column for column in columns if column is not None))


def start_at_calibration(older: Candidate) -> Candidate:
    """The same cause as one that began after the calibration: nothing of it was absorbed. Of a
    cause of the first order only."""
    columns = tuple(
        replace(
            column,
            name=column.name.removesuffix(f", {OLDER}"),
            terms=tuple(term for term in column.terms if term.basis),
        )
        for column in older.columns
    )
    return replace(older, columns=columns)


def _beyond(column: Column, facts: SessionFacts) -> Column | None:
    terms: list[Term] = []
    for term in column.terms:
        if len(term.basis) != 1 or not isinstance(term.basis[0], Temperature):
            return None
        absorbed = list(_absorbed(term, term.basis[0], facts))
        if not absorbed or any(absorbed_term.basis == term.basis for absorbed_term in absorbed):
            return None
        terms += [term, *absorbed]
    return replace(column, name=f"{column.name}, {OLDER}", terms=tuple(terms)) if terms else None


def _absorbed(term: Term, factor: Temperature, facts: SessionFacts) -> Iterator[Term]:
    """Terms of what the calibration has that take away what it has absorbed of a *term*; growth
    that it could not know took up none."""
    if factor.lag_s or factor.zone_c or not set(factor.weights) <= set(facts.calibrated_c):
        return
    reference_c = facts.reference_c if factor.reference_c is None else factor.reference_c
    known_orders = sorted(
        model_factor.order
        for model_term in facts.terms
        if model_term.parameter == term.parameter and len(model_term.basis) == 1
        if term.parameter not in facts.open_growth
        if isinstance(model_factor := model_term.basis[0], Temperature)
        if model_factor.model_copy(update={"order": factor.order}) == factor
    )
    powers = [0, *known_orders]
    rise = sum(w * np.array(facts.calibrated_c[s]) for s, w in factor.weights.items()) - reference_c
    columns: F64 = np.vander(np.asarray(rise), max(powers) + 1, increasing=True)[:, powers]
    shares = np.linalg.lstsq(columns, np.asarray(rise) ** factor.order, rcond=1e-6)[0]
    for power, share in zip(powers, shares, strict=True):
        basis = [factor.model_copy(update={"order": power})] if power else []
        coefficient = -term.coefficient * float(share)
        yield Term(parameter=term.parameter, basis=basis, coefficient=coefficient)

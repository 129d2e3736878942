"""Causes that existed when the calibration under test was made.

An arm whose joint turns with temperature did so while it was calibrated. Its constants absorbed
what they could at those temperatures; so did the powers of that temperature in the calibration. The
remainder is the cause's course less the absorbed part. At the calibration's only temperature it is
zero, whatever the reference temperature. The same holds for unnamed effects of a temperature.
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
    """Return the cause less the part that the calibration under test has absorbed.

    Returns None if no calibration is given, so that nothing was absorbed, or if all of it was.
    """
    if not facts.calibrated_c or candidate.refine is not None:
        return None
    columns = [_beyond(column, facts) for column in candidate.columns]
    if any(column is None for column in columns):
        return None
    return replace(candidate, columns=tuple(column for column in columns if column is not None))


def start_at_calibration(older: Candidate) -> Candidate:
    """Return the cause as one that began after the calibration, of which nothing was absorbed.

    It must be a cause of the first order.
    """
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
    """Yield the calibration's terms that subtract the absorbed part of a *term*.

    An expansion that the calibration leaves unknown is absorbed by constants only.
    """
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

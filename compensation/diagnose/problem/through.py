"""Causes that act through other findings: a sensor that reads wrong errs in all that goes by it.

A sensor's offset adds its size times the derivative of the model by its temperature: of the terms
under test, and of what was found since. Its columns are made anew as findings join and their
amplitudes change; so the product of two unknowns, the offset and the other finding's amplitude, is
fitted by turns, and what is written of both is what was fitted.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.signatures import Signatures, compile_candidates
from armd.compensation.effects import catalogue
from armd.compensation.effects.effect import Acting, Candidate, SessionFacts
from armd.compensation.model.arm import Arm
from armd.compensation.model.slow_factors import Temperature

#: Columns are made anew where amplitudes have changed by more than this share of the largest: of
#: an offset that shows a hundred noise units through them, that is one.
CHANGED = 0.01


def acting(fit: Fit) -> tuple[Acting, ...]:
    """The findings through which others act, at their amplitudes; as they were when the others'
    columns were made, where they have hardly changed."""
    before = [one for c in fit.findings for one in c.through or ()]
    found = []
    for candidate, values in zip(fit.findings, fit.amplitudes, strict=True):
        if _goes_with_temperature(candidate):
            now = Acting(candidate, tuple(map(float, values)))
            found.append(next((one for one in before if _hardly_changed(one, now)), now))
    return tuple(found)


def made_anew(
    candidate: Candidate, facts: SessionFacts, acting: Sequence[Acting]
) -> Candidate | None:
    """A finding that acts through others, made with these *acting*, or itself where it was; None
    where there is nothing left through which it acts."""
    if candidate.through in (None, catalogue.acting_on(candidate, acting, facts)):
        return candidate
    return next((c for c in catalogue.under(facts, acting) if c.is_like(candidate)), None)


def with_acting(
    signatures: Signatures,
    fit: Fit,
    facts: SessionFacts,
    refused: Collection[tuple[str, str]],
    arm: Arm,
) -> Signatures:
    """The signatures with those candidates, none of a *refused* place, that act through what a fit
    has found."""
    found = acting(fit)
    candidates = catalogue.under(facts, found) if found else ()
    more = [c for c in candidates if c.through and c.place not in refused]
    return signatures.with_more(compile_candidates(more, fit.linear, arm)) if more else signatures


def _goes_with_temperature(candidate: Candidate) -> bool:
    """Of causes that have a name, and do not act through others themselves."""
    if candidate.cause == "unknown" or catalogue.CATALOGUE[candidate.cause].through_terms:
        return False
    return any(isinstance(factor, Temperature) for factor in candidate.factors)


def _hardly_changed(before: Acting, now: Acting) -> bool:
    if before.candidate != now.candidate:
        return False
    typical = np.array([column.typical for column in now.candidate.columns])
    old, new = (np.array(one.amplitudes) / typical for one in (before, now))
    return bool(np.abs(new - old).max() <= CHANGED * np.abs(new).max())

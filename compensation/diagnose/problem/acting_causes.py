"""Causes that act through other findings: a wrong sensor affects all that depends on it.

A sensor's offset adds its size times the derivative of the model by that sensor's temperature. The
model includes the terms under test and those of the findings so far. The columns of the offset are
rebuilt as findings join and their amplitudes change. The product of two unknowns, the offset and
the other finding's amplitude, is thus fitted by alternation, and both are written as fitted. The
lag of a link is treated alike.

Where two sensors are exchanged, all else that depends on one of them depends on the other. Such a
cause is a candidate of its own, and only beside the exchange.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from armd.compensation.diagnose.constants import COLUMNS_CHANGED
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.signatures import Signatures, compile_candidates
from armd.compensation.effects import catalogue
from armd.compensation.effects.effect import Acting, Candidate, SessionFacts
from armd.compensation.model.arm import Arm
from armd.compensation.model.slow_factors import Temperature


def find_acting(fit: Fit) -> tuple[Acting, ...]:
    """Return the findings through which other causes act, at their fitted amplitudes.

    A finding keeps the amplitudes with which the other causes' columns were made, if they have
    hardly changed since (`COLUMNS_CHANGED`).
    """
    before = [cause for c in fit.findings for cause in c.through or ()]
    causes = []
    for candidate, values in zip(fit.findings, fit.amplitudes, strict=True):
        if _goes_with_temperature(candidate):
            now = Acting(candidate, tuple(map(float, values)))
            causes.append(next((cause for cause in before if _hardly_changed(cause, now)), now))
    return tuple(causes)


def update_candidate(
    candidate: Candidate, facts: SessionFacts, acting: Sequence[Acting]
) -> Candidate | None:
    """Rebuild a finding that acts through others, for these *acting* findings.

    Returns the finding itself where nothing changed. Returns None where no finding is left through
    which it acts, or where the exchange of sensors that it depends on is gone.
    """
    if catalogue.CATALOGUE[candidate.cause].by_temperature:
        places = {cause.candidate.place for cause in acting}
        all_there = all(cause.candidate.place in places for cause in candidate.through or ())
        return candidate if all_there else None
    if candidate.through in (None, catalogue.select_acting(candidate, acting, facts)):
        return candidate
    for rebuilt in catalogue.list_candidates_under(facts, acting):
        if rebuilt.is_like(candidate):
            return rebuilt
        if rebuilt.place == candidate.place and rebuilt.elsewhere is not None:
            at_its_value = rebuilt.elsewhere(candidate.setting[0][1])
            if at_its_value.is_like(candidate):
                return at_its_value
    return None


def add_acting(
    signatures: Signatures,
    fit: Fit,
    facts: SessionFacts,
    refused: Collection[tuple[str, str]],
    arm: Arm,
) -> Signatures:
    """Return the signatures with the candidates that act through a fit's findings added."""
    candidates = list_acting_through(fit, facts, refused)
    return (
        signatures.with_more(compile_candidates(candidates, fit.linear, arm))
        if candidates
        else signatures
    )


def list_acting_through(
    fit: Fit, facts: SessionFacts, refused: Collection[tuple[str, str]]
) -> list[Candidate]:
    """List candidates that act through a fit's findings, or that an exchange of sensors adds.

    Candidates of a *refused* place are skipped.
    """
    causes = find_acting(fit)
    candidates = list(catalogue.list_candidates_under(facts, causes)) if causes else []
    for exchanged in (c for c in fit.findings if c.cause == "sensor_swapped"):
        candidates += catalogue.list_exchanged(facts, exchanged)
    return [c for c in candidates if c.through and c.place not in refused]


def _goes_with_temperature(candidate: Candidate) -> bool:
    """Return whether a named cause has a factor of temperature."""
    if candidate.cause == "unknown":
        return False
    return any(isinstance(factor, Temperature) for factor in candidate.factors)


def _hardly_changed(before: Acting, now: Acting) -> bool:
    if before.candidate != now.candidate:
        return False
    prior_sd = np.array([column.prior_sd for column in now.candidate.columns])
    old, new = (np.array(cause.amplitudes) / prior_sd for cause in (before, now))
    return bool(np.abs(new - old).max() <= COLUMNS_CHANGED * np.abs(new).max())

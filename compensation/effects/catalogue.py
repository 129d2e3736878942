"""All causes armd can name: whatever stands in the rooms beside this file.

A module there has an `EFFECT`, or several `EFFECTS`: adding a cause is adding its file.
"""

from __future__ import annotations

import math
import pkgutil
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib import import_module

from armd.compensation.effects import encoder, mechanical, setup, thermal, unknown
from armd.compensation.effects.effect import (
    ARC_SECOND,
    Acting,
    Candidate,
    Effect,
    SessionFacts,
)
from armd.compensation.model.arm import Arm

ROOMS = (encoder, mechanical, thermal, setup)
#: Effects that are as coarse as the arm's encoders have the typical size of an arm whose encoders
#: tell this apart, or less: a hobby servo's magnetic encoder of 12 bits is half a degree off where
#: a disc of 23 bits is seconds off, and so are its bearings and its printed links.
FINE_RAD = 6 * ARC_SECOND


def _found() -> Iterator[Effect]:
    """Room by room, then by name; what has no name comes last."""
    for room in ROOMS:
        for name in sorted(module.name for module in pkgutil.iter_modules(room.__path__)):
            module = import_module(f"{room.__name__}.{name}")
            yield from getattr(module, "EFFECTS", None) or (module.EFFECT,)
    yield unknown.EFFECT


CATALOGUE: dict[str, Effect] = {effect.cause: effect for effect in _found()}


def candidates(facts: SessionFacts) -> Iterator[Candidate]:
    """Every candidate that this arm and these sessions allow, the general basis included."""
    coarseness = _coarseness(facts.arm)
    for effect in CATALOGUE.values():
        if effect.as_coarse_as_encoders and coarseness > 1.0:
            yield from (_larger(candidate, coarseness) for candidate in effect.candidates(facts))
        else:
            yield from effect.candidates(facts)


def under(facts: SessionFacts, acting: Sequence[Acting]) -> Iterator[Candidate]:
    """The candidates that act through the model's terms, with findings *acting* in the model."""
    terms = (*facts.terms, *(term for found in acting for term in found.terms))
    for effect in CATALOGUE.values():
        if effect.through_terms is not None:
            for candidate in effect.through_terms(replace(facts, terms=terms)):
                yield replace(candidate, through=acting_on(candidate, acting, facts))


def acting_on(
    candidate: Candidate, acting: Sequence[Acting], facts: SessionFacts
) -> tuple[Acting, ...]:
    """Those of the findings *acting* through which a candidate acts: they share a sensor."""
    own = set(candidate.depends_on) & set(facts.sensors)
    return tuple(found for found in acting if own & set(found.candidate.depends_on))


def _coarseness(arm: Arm) -> float:
    """A count of the coarsest encoder over `FINE_RAD`; 1 for all that are finer, or not known."""
    counts = [joint.counts_per_turn for joint in arm.joint if joint.counts_per_turn is not None]
    return max([1.0, *(2 * math.pi / count / FINE_RAD for count in counts)])


def _larger(candidate: Candidate, factor: float) -> Candidate:
    """The same cause, typically *factor* times as large; its refinements too."""
    columns = tuple(
        replace(column, typical=column.typical * factor) for column in candidate.columns
    )
    refine = candidate.refine
    if refine is None:
        return replace(candidate, columns=columns)
    return replace(
        candidate, columns=columns, refine=lambda: [_larger(finer, factor) for finer in refine()]
    )

"""A temperature sensor reads wrong by a constant.

Only a calibration made before can tell: a fit to the same sessions absorbs it in the lengths.
"""

from collections.abc import Iterator

from armd.compensation.effects import location
from armd.compensation.effects.effect import F64, Candidate, Column, Effect, SessionFacts, plain
from armd.compensation.model.terms import Temperature, Term


def candidates(facts: SessionFacts) -> Iterator[Candidate]:
    if not facts.held:
        return
    for name in facts.sensors:
        terms = tuple(piece for term in facts.terms for piece in _derivative(term, name))
        if terms:
            # A sensor tens of kelvin off is noticed long before any length is.
            column = Column("offset", "K", 0.5, terms, reach=5.0)
            yield Candidate("sensor_offset", location.sensors(name), (column,), (name,))


def _derivative(term: Term, sensor: str) -> Iterator[Term]:
    """d term / d T_sensor, for terms that are a single power of a temperature."""
    if len(term.basis) != 1 or not isinstance(term.basis[0], Temperature):
        return
    factor = term.basis[0]
    weight = factor.weights.get(sensor, 0.0)
    if weight == 0.0 or term.coefficient == 0.0 or factor.zone_c is not None:
        return
    lower = [factor.model_copy(update={"order": factor.order - 1})] if factor.order > 1 else []
    coefficient = term.coefficient * weight * factor.order
    yield Term(parameter=term.parameter, basis=list(lower), coefficient=coefficient)


def reading(candidate: Candidate, amplitudes: F64) -> str:
    # what the model lacks is the true temperature minus the one read
    return f"{candidate.location} reads {plain(-amplitudes[0], sign='+')} K wrong"


EFFECT = Effect(
    "sensor_offset",
    "a sensor, its cable or its converter is off by a constant",
    "constants of the links on it",
    "let the arm rest overnight and compare all sensors",
    candidates,
    reading,
    "a calibration to compare with, with terms of temperature",
)

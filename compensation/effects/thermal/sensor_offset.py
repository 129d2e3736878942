"""A temperature sensor reads wrong: by a constant, or by more and more.

Of a constant only a calibration made before can tell: a fit to the same sessions absorbs it.
"""

from collections.abc import Iterator, Sequence

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.courses import Function, drifts, goes, is_drift
from armd.compensation.effects.effect import Candidate, Column, Effect, SessionFacts, plain
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term

TYPICAL_K = 0.5
#: What a sensor loses while it is being used is less: its contact loosens, its cable warms.
TYPICAL_DRIFT_K = 0.1


def candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for name in facts.sensors:
        terms = tuple(piece for term in facts.terms for piece in _derivative(term, name))
        if not terms:
            continue
        yield from _drifting(facts, name, terms)
        if facts.held:
            # A sensor tens of kelvin off is noticed long before any length is.
            column = Column("offset", "K", TYPICAL_K, terms, reach=5.0)
            yield Candidate("sensor_offset", location.sensors(name), (column,), (name,))


def _drifting(facts: SessionFacts, sensor: str, terms: Sequence[Term]) -> Iterator[Candidate]:
    """What a fit to the same sessions does not absorb: an offset that changes."""

    def columns(function: Function) -> list[Column]:
        moving = tuple(
            term.model_copy(
                update={"basis": [*term.basis, factor], "coefficient": share * term.coefficient}
            )
            for share, factor in function.pieces
            for term in terms
        )
        typical = TYPICAL_DRIFT_K / function.largest
        return [Column(f"offset {function.name}", "K" + function.per, typical, moving, reach=5.0)]

    where = (sensor, "time_s")
    yield from drifts(facts, "sensor_offset", location.sensors(sensor), columns, where)


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
    if is_drift(candidate):
        return f"the error of {candidate.location} {goes(candidate)}"
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

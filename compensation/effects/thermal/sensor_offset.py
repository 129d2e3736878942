"""A temperature sensor reads wrong: by a constant, or by an increasing error.

A constant is detected only with an earlier calibration: a fit to the same sessions absorbs it.
"""

from collections.abc import Iterator, Sequence

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.by_temperature import find_temperature
from armd.compensation.effects.courses import Function, describe_course, is_drift, make_drifts
from armd.compensation.effects.effect import Candidate, Column, Effect, SessionFacts
from armd.compensation.model.terms import Term
from armd.compensation.wording import format_plain

TYPICAL_K = 0.5
#: A sensor's error changes by less during its use: its contact loosens, its cable warms.
TYPICAL_DRIFT_K = 0.1


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for name in facts.sensors:
        if terms := _derivatives(facts.terms, name):
            yield from _drifting(facts, name, terms)
            yield from _steady(facts, name, terms)


def list_acting_offsets(facts: SessionFacts, acting_terms: Sequence[Term]) -> Iterator[Candidate]:
    """Yield constant offsets of sensors that act through other findings, too.

    Drifts are excluded: through those terms a drift could follow anything that they do not explain.
    """
    for name in facts.sensors:
        yield from _steady(facts, name, _derivatives((*facts.terms, *acting_terms), name))


def _derivatives(terms: Sequence[Term], sensor: str) -> tuple[Term, ...]:
    return tuple(piece for term in terms for piece in _derivative(term, sensor))


def _steady(facts: SessionFacts, sensor: str, terms: tuple[Term, ...]) -> Iterator[Candidate]:
    if facts.has_fixed_constants and terms:
        # A sensor that is tens of kelvin off is noticed long before any length.
        column = Column("offset", "K", TYPICAL_K, terms, reach=5.0)
        place = location.sensors(sensor)
        yield Candidate("sensor_offset", place, (column,), (sensor,), through=())


def _drifting(facts: SessionFacts, sensor: str, terms: Sequence[Term]) -> Iterator[Candidate]:
    """Yield offsets that change in time, which a fit to the same sessions does not absorb."""

    def columns(function: Function) -> list[Column]:
        moving = tuple(
            term.model_copy(
                update={"basis": [*term.basis, factor], "coefficient": share * term.coefficient}
            )
            for share, factor in function.pieces
            for term in terms
        )
        prior_sd = TYPICAL_DRIFT_K / function.largest
        return [Column(f"offset {function.name}", "K" + function.per, prior_sd, moving, reach=5.0)]

    variables = (sensor, "time_s")
    yield from make_drifts(facts, "sensor_offset", location.sensors(sensor), columns, variables)


def _derivative(term: Term, sensor: str) -> Iterator[Term]:
    """Yield d term / d T_sensor for terms with a single power of a temperature.

    They may be products of that power and other factors.
    """
    factor = find_temperature(term)
    if factor is None or factor.zone_c is not None:
        return
    weight = factor.weights.get(sensor, 0.0)
    if weight == 0.0:
        return
    other_factors = [f for f in term.basis if f is not factor]
    lower = [factor.model_copy(update={"order": factor.order - 1})] if factor.order > 1 else []
    coefficient = term.coefficient * weight * factor.order
    yield Term(parameter=term.parameter, basis=[*lower, *other_factors], coefficient=coefficient)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    if is_drift(candidate):
        return f"the error of {candidate.location} {describe_course(candidate)}"
    # the amplitude is the true temperature minus the one read
    return f"{candidate.location} reads {format_plain(-amplitudes[0], sign='+')} K wrong"


EFFECT = Effect(
    "sensor_offset",
    "a sensor, its cable or its converter is off by a constant",
    "constants of the links on it",
    "let the arm rest overnight and compare all sensors",
    list_candidates,
    describe,
    "a calibration to compare with, with terms of temperature",
    through_terms=list_acting_offsets,
)

"""Two temperature sensors are exchanged.

Under a given calibration, every term of one sensor takes the other's temperature; the one amplitude
is 1 if they are exchanged. Other findings are then searched for with the other sensor
(`list_exchanged` of the catalogue). In a model fitted to the same sessions, each link follows the
other's sensor.
"""

from collections.abc import Iterator
from itertools import combinations

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import (
    Candidate,
    Column,
    Effect,
    SessionFacts,
    list_lengths,
    make_temperature,
    tie,
)
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term

TYPICAL_PER_K = 10e-6


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for a, b in combinations(facts.sensors, 2):
        columns = (
            _exchanged(facts, a, b)
            if facts.has_fixed_constants
            else _make_link_columns(facts, a, b)
        )
        if columns:
            yield Candidate("sensor_swapped", location.sensors(a, b), columns, (a, b))


def _exchanged(facts: SessionFacts, a: str, b: str) -> tuple[Column, ...]:
    terms = []
    for term in facts.terms:
        if len(term.basis) != 1 or not isinstance(term.basis[0], Temperature):
            continue
        factor = term.basis[0]
        weights = {{a: b, b: a}.get(name, name): w for name, w in factor.weights.items()}
        if weights == factor.weights or term.coefficient == 0.0:
            continue
        swapped = factor.model_copy(update={"weights": weights})
        for piece, sign in ((swapped, 1.0), (factor, -1.0)):
            coefficient = sign * term.coefficient
            terms.append(Term(parameter=term.parameter, basis=[piece], coefficient=coefficient))
    return (Column("exchanged", "1", 1.0, tuple(terms)),) if terms else ()


def _make_link_columns(facts: SessionFacts, a: str, b: str) -> tuple[Column, ...]:
    columns = []
    for sensor, other_sensor in ((a, b), (b, a)):
        pairs = [
            pair
            for k in facts.joints
            if facts.weights(k) == {sensor: 1.0}
            for pair in list_lengths(facts, k)
        ]
        if pairs:
            terms = tie(pairs, make_temperature({other_sensor: 1.0}))
            columns.append(
                Column(f"links of {sensor} on {other_sensor}", "1/K", TYPICAL_PER_K, terms)
            )
    return tuple(columns) if len(columns) == 2 else ()


def describe(candidate: Candidate, amplitudes: F64) -> str:
    if len(amplitudes) == 1:
        return f"{candidate.location} are exchanged ({amplitudes[0]:.0%} of an exchange)"
    return f"the links on {candidate.location} follow each other's sensor"


EFFECT = Effect(
    "sensor_swapped",
    "two plugs are exchanged, or the channel table is wrong",
    "a link with one wrong sensor; lag",
    "warm one link by hand and watch which sensor answers",
    list_candidates,
    describe,
    "temperatures of two sensors at least that vary against each other",
)

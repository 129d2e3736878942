"""Terms that depend on a temperature: their sensor, and the change if another replaces it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from armd.compensation.model.slow_factors import SlowFactor, Temperature
from armd.compensation.model.terms import Term


def find_temperature(term: Term) -> Temperature | None:
    """Return the temperature that a term depends on by one factor, also times factors of the pose.

    Returns None if there is none, or if the term depends on time, too.
    """
    slow = [factor for factor in term.basis if isinstance(factor, SlowFactor)]
    if len(slow) != 1 or not isinstance(slow[0], Temperature) or term.coefficient == 0.0:
        return None
    return slow[0]


def is_difference(weights: Mapping[str, float]) -> bool:
    """Return whether sensors are compared, so that no reference is needed."""
    return abs(sum(weights.values())) < 1e-9


def replace_temperature(term: Term, another: Temperature) -> Iterator[Term]:
    """Yield the terms that a term adds if *another* temperature replaces its own."""
    for factor in term.basis:
        if isinstance(factor, Temperature):
            yield from replace_part(term, 1.0, factor, another)


def replace_part(
    term: Term, weight: float, part: Temperature, another: Temperature
) -> Iterator[Term]:
    """Yield the terms that a term adds if *another* temperature replaces a part of its own.

    Its own temperature is a sum that contains *part* with this *weight*.
    """
    yield _make_term(term, another, weight * term.coefficient)
    yield _make_term(term, part, -weight * term.coefficient)


def _make_term(term: Term, factor: Temperature, coefficient: float) -> Term:
    basis = [
        factor if isinstance(term_factor, Temperature) else term_factor
        for term_factor in term.basis
    ]
    return Term(parameter=term.parameter, basis=basis, coefficient=coefficient)

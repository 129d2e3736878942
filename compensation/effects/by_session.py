"""Effects that have another value in each session, independent of the next one.

Examples are two operators who take turns, a stylus that is screwed in anew, a seat that is cleaned
or not. A drift continues from its last value and a step remains. Here the values of the sessions
are independent of each other. If the constants come from a calibration, the values are departures
from it; if the same sessions gave the constants, they are departures from the sessions' mean. After
the last session the effect is zero.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.effects.courses import Function, is_walk
from armd.compensation.effects.effect import Candidate, Column, SessionFacts
from armd.compensation.model.slow_factors import After
from armd.compensation.model.terms import Factor, Term

#: Two different sessions are a step. With very many sessions, one value for each explains nothing.
LEAST_SESSIONS, MOST_SESSIONS = 3, 16
#: The effect ends this long after the very last reading.
OVER_S = 1.0
AGAINST = " against those before"
#: The relative size of a sum that counts as zero.
ROUNDING = 1e-9


def make_session_functions(facts: SessionFacts) -> list[Function]:
    """Make functions that together give every session a value of its own.

    Their columns are named "motion, function".
    """
    count, names = len(facts.sessions), [name for name, *_ in facts.sessions]
    if not LEAST_SESSIONS <= count <= MOST_SESSIONS:
        return []
    edges = _edges(facts)
    if facts.has_fixed_constants:
        rows = np.eye(count)
        return [_function(name, 1.0, row, edges) for name, row in zip(names, rows, strict=True)]
    functions = []
    for k in range(1, count):
        against = np.zeros(count)  # amplitude: difference from the mean of earlier sessions
        against[:k], against[k] = -1.0 / (k + 1), k / (k + 1)
        size = math.sqrt(k / (k + 1))
        functions.append(_function(f"{names[k]}{AGAINST}", size, against, edges))
    return functions


def make_column(
    function: Function,
    motion: str,
    unit: str,
    prior_sd: float,
    weights: Sequence[tuple[str, float]],
) -> Column:
    """Make the column of one function; *weights* are those of the parameters that it changes."""
    name = f"{motion}, {function.name}"
    return Column(name, unit, prior_sd / function.largest, function.terms(weights))


def is_by_session(candidate: Candidate) -> bool:
    """Return whether a candidate gives every session a value of its own, with several instants."""
    factors = list(candidate.factors)
    instants = {factor.instant_unix_s for factor in factors if isinstance(factor, After)}
    return len(instants) > 1 and all(isinstance(factor, After) for factor in factors)


def can_follow_anything(candidate: Candidate) -> bool:
    """Return whether a candidate can follow any course in time: one value for each session, or a
    walk.

    Together a joint that turns with temperature and one whose disc slipped can do so, too.
    """
    return is_by_session(candidate) or is_walk(candidate)


def compute_values_by_session(
    candidate: Candidate, amplitudes: F64
) -> tuple[list[tuple[str, F64]], str]:
    """Return each session's name and motions (motions,), and in words what they are relative to."""
    instants = _instants(candidate)
    against_mean = is_against_mean(candidate)
    functions = len(instants) - 1 - against_mean
    values = amplitudes.reshape(functions, -1)
    motions = values.shape[1]
    names = [column.name.split(", ", 1)[1] for column in candidate.columns[::motions]]
    if not against_mean:
        return list(zip(names, values, strict=True)), "the calibration"
    of_all = np.zeros((1, motions))
    for further in values:
        of_all = np.vstack([of_all, of_all.mean(axis=0) + further])
    named = (name.removesuffix(AGAINST) for name in names)
    return list(zip(named, of_all[1:], strict=True)), "the first session"


def is_against_mean(candidate: Candidate) -> bool:
    """Return whether a candidate's columns are departures from the sessions' mean, by its terms."""
    return all(
        np.abs(values.sum(axis=0)).max() <= ROUNDING * np.abs(values).max()
        for values in _values_of_parameters(candidate).values()
    )


@dataclass(frozen=True)
class Written:
    """One parameter of such an effect in a calibration: its value outside the sessions, and its
    terms.
    """

    parameter: str
    constant: F64  # (columns,) per unit of each amplitude
    terms: tuple[Term, ...]


def as_written(candidate: Candidate, amplitudes: F64, effect: str) -> Iterator[Written]:
    """Yield one term for each session's beginning and parameter.

    Constants that the same sessions gave become those of the median session: if one session in five
    differs, the mean of all is right for none.
    """
    instants, against_mean = _instants(candidate), is_against_mean(candidate)
    for name, values in _values_of_parameters(candidate).items():
        constant = np.zeros(len(candidate.columns))
        if against_mean:
            order, half = np.argsort(values @ amplitudes, kind="stable"), (len(values) - 1) / 2
            constant = values[order[[math.floor(half), math.ceil(half)]]].mean(axis=0)
        none = np.zeros((1, len(candidate.columns)))
        steps = np.diff(np.vstack([none, values, none]), axis=0)
        steps[0] -= constant
        steps[-1] += constant
        terms = [
            Term(
                parameter=name,
                basis=[After(instant_unix_s=instant)],
                coefficient=float(step),
                effect=effect,
            )
            for instant, step in zip(instants, steps @ amplitudes, strict=True)
        ]
        yield Written(name, constant, tuple(terms))


def _instants(candidate: Candidate) -> list[float]:
    """Return where each session begins, and where the last one ends."""
    return sorted({f.instant_unix_s for f in candidate.factors if isinstance(f, After)})


def _values_of_parameters(candidate: Candidate) -> dict[str, F64]:
    """Return each parameter's value in each session (sessions, columns), of unit amplitudes."""
    instants, steps = _instants(candidate), dict[str, F64]()
    for j, unit_column in enumerate(candidate.columns):
        for term in unit_column.terms:
            (factor,) = term.basis
            if isinstance(factor, After):
                nothing = np.zeros((len(instants), len(candidate.columns)))
                parameter_steps = steps.setdefault(term.parameter, nothing)
                parameter_steps[instants.index(factor.instant_unix_s), j] += term.coefficient
    return {
        name: np.cumsum(parameter_steps, axis=0)[:-1] for name, parameter_steps in steps.items()
    }


def _edges(facts: SessionFacts) -> list[float]:
    """Return where each session begins, and where the last one ends; (sessions + 1,)
    Unix seconds.
    """
    pairs = itertools.pairwise(facts.sessions)
    between = [(end + start) / 2.0 for (_, _, end), (_, start, _) in pairs]
    return [facts.start_unix_s, *between, facts.end_unix_s + OVER_S]


def _function(name: str, size: float, values: F64, edges: list[float]) -> Function:
    steps = np.diff(np.concatenate([[0.0], values, [0.0]]))
    pieces: list[tuple[float, Factor]] = [
        (float(step), After(instant_unix_s=instant))
        for step, instant in zip(steps, edges, strict=True)
    ]
    return Function(name, "", size, tuple(pieces))

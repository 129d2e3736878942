"""What stands otherwise in each session, and nobody knows how in the next one.

Two operators press a probe by turns, a stylus is screwed in anew, a seat is cleaned or not. A drift
goes on from where it was, a step stays; of this a later session knows nothing. Each session has a
value of its own, drawn as independently as the others. Where constants come from a calibration,
they are what it departs from; where the same sessions gave them, from the sessions' mean. After the
last session nothing of it is left.
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

#: Two sessions that differ are a step. Of very many, one value each is no explanation.
LEAST_SESSIONS, MOST_SESSIONS = 3, 16
#: After the last reading of all, it is over.
OVER_S = 1.0
AGAINST = " against those before"


def by_session(facts: SessionFacts) -> list[Function]:
    """Functions that together let every session have a value of its own; columns of them are named
    "motion, function"."""
    count, names = len(facts.sessions), [name for name, *_ in facts.sessions]
    if not LEAST_SESSIONS <= count <= MOST_SESSIONS:
        return []
    edges = _edges(facts)
    if facts.held:
        rows = np.eye(count)
        return [_function(name, 1.0, row, edges) for name, row in zip(names, rows, strict=True)]
    found = []
    for k in range(1, count):
        against = np.zeros(count)  # its amplitude is how far it is from the mean of those before
        against[:k], against[k] = -1.0 / (k + 1), k / (k + 1)
        size = math.sqrt(k / (k + 1))
        found.append(_function(f"{names[k]}{AGAINST}", size, against, edges))
    return found


def column(
    function: Function, motion: str, unit: str, typical: float, weights: Sequence[tuple[str, float]]
) -> Column:
    """Of one function, what it moves: *weights* of parameters."""
    name = f"{motion}, {function.name}"
    return Column(name, unit, typical / function.largest, function.terms(weights))


def is_by_session(candidate: Candidate) -> bool:
    """Whether it lets every session have a value of its own, several instants apart."""
    factors = list(candidate.factors)
    instants = {factor.instant_unix_s for factor in factors if isinstance(factor, After)}
    return len(instants) > 1 and all(isinstance(factor, After) for factor in factors)


def follows_anything(candidate: Candidate) -> bool:
    """Whether it follows whatever goes with time, as a value for each session does, or a walk. So
    do a joint that turns with temperature and one whose disc slipped, together."""
    return is_by_session(candidate) or is_walk(candidate)


def values_by_session(candidate: Candidate, amplitudes: F64) -> tuple[dict[str, F64], str]:
    """What its motions come to (motions,) in each session, by name, and against what."""
    names = dict.fromkeys(column.name.split(", ", 1)[1] for column in candidate.columns)
    values = amplitudes.reshape(len(names), -1)
    if not next(iter(names)).endswith(AGAINST):
        return dict(zip(names, values, strict=True)), "the calibration"
    of_all = np.zeros((1, values.shape[1]))
    for further in values:
        of_all = np.vstack([of_all, of_all.mean(axis=0) + further])
    named = (name.removesuffix(AGAINST) for name in names)
    return dict(zip(named, of_all[1:], strict=True)), "the first session"


@dataclass(frozen=True)
class Written:
    """What a calibration has of one parameter: what it is when no session is on, and terms."""

    parameter: str
    constant: F64  # (columns,) per unit of each amplitude
    terms: tuple[Term, ...]


def as_written(candidate: Candidate, amplitudes: F64, effect: str) -> Iterator[Written]:
    """One term for each session's beginning and parameter.

    Constants that the same sessions gave become those of the middle one: where one session in five
    stood otherwise, the mean of all is right for none.
    """
    names = dict.fromkeys(term.parameter for c in candidate.columns for term in c.terms)
    instants = sorted({f.instant_unix_s for f in candidate.factors if isinstance(f, After)})
    for name in names:
        steps = np.zeros((len(instants), len(candidate.columns)))
        for j, column in enumerate(candidate.columns):
            for term in column.terms:
                (factor,) = term.basis
                if term.parameter == name and isinstance(factor, After):
                    steps[instants.index(factor.instant_unix_s), j] += term.coefficient
        each = np.cumsum(steps, axis=0)[:-1]  # (sessions, columns)
        constant = np.zeros(len(candidate.columns))
        if candidate.columns[0].name.endswith(AGAINST):
            order, half = np.argsort(each @ amplitudes, kind="stable"), (len(each) - 1) / 2
            constant = each[order[[math.floor(half), math.ceil(half)]]].mean(axis=0)
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


def _edges(facts: SessionFacts) -> list[float]:
    """Where each session begins, and where the last one is over; (sessions + 1,) Unix seconds."""
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

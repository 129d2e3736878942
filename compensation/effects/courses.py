"""Courses in time that a drift may take, each a few functions that share one beginning; and steps.

Steady, curved, relaxing, settling anew in each session, with the day, or wandering: what creeps,
swells, settles or breathes does so along one of these, and each is weighed against steps at an
instant, so that a staircase is told only where it is one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.effects.effect import Candidate, Column, SessionFacts, tie
from armd.compensation.effects.location import Location
from armd.compensation.model.slow_factors import (
    After,
    Daily,
    Dated,
    Period,
    Relaxation,
    SlowFactor,
    Time,
)
from armd.compensation.model.terms import Factor, Term
from armd.compensation.wording import format_plain

OF_A_WALK = 1.0  # 1; how far a walk may stray over the time seen, of how far it went
OF_A_COURSE = 0.3  # 1; the same of a creep, which is never quite an exponential

#: Time constants, as shares of the time seen: with a shorter one all is over before much was
#: measured, with a longer one it is a straight line, or nearly. Twice apart, refined in between.
SHARES = (1 / 96, 1 / 48, 1 / 24, 1 / 12, 1 / 6, 1 / 3, 2 / 3)
FINER = (0.6, 0.7, 0.8, 0.9, 1.1, 1.25, 1.4, 1.65)
#: The same of the longest session, where something settles anew in each.
SETTLING_SHARES = (1 / 12, 1 / 6, 1 / 3, 2 / 3)
DAY_S = 86400.0
#: Less of a day than this looks like a curve.
LEAST_DAYS = 0.6
#: A wandering is followed from knot to knot: the ends of the sessions; where these are few, each
#: session in pieces, so many in a single one.
LEAST_PIECES = 12


@dataclass(frozen=True)
class Function:
    """One function of time, a sum of weighted factors; its largest value over the time seen."""

    name: str
    per: str  # what its amplitude is divided by: "", "/h", …
    largest: float
    pieces: tuple[tuple[float, Factor], ...]

    def terms(self, weights: Sequence[tuple[str, float]]) -> tuple[Term, ...]:
        """Terms on parameters with *weights* that share the function's amplitude."""
        return tuple(
            term
            for share, factor in self.pieces
            for term in tie([(name, weight * share) for name, weight in weights], factor)
        )


@dataclass(frozen=True)
class Course:
    """One way to go: its functions, what is scanned, and the same at other values of the scan."""

    functions: tuple[Function, ...]
    setting: tuple[tuple[str, float, str], ...] = ()
    finer: Callable[[], list[Course]] | None = None
    elsewhere: Callable[[float], Course] | None = None


MakeColumns = Callable[[Function], Sequence[Column]]


def make_drifts(
    facts: SessionFacts,
    cause: str,
    location: Location,
    make: MakeColumns,
    depends_on: tuple[str, ...] = ("time_s",),
) -> Iterator[Candidate]:
    """Candidates for something that goes along each course; *make*: a function's columns."""
    before = _make_prior_functions(facts)
    for course in list_courses(facts):
        yield _along(course, before, cause, location, make, depends_on)


def _along(
    course: Course,
    before: Sequence[Function],
    cause: str,
    location: Location,
    make: MakeColumns,
    depends_on: tuple[str, ...],
) -> Candidate:
    finer, elsewhere = course.finer, course.elsewhere

    def rebuild(value: float) -> Candidate:
        assert elsewhere is not None
        return _along(elsewhere(value), before, cause, location, make, depends_on)

    def refine() -> list[Candidate]:
        assert finer is not None
        return [
            _along(finer_course, before, cause, location, make, depends_on)
            for finer_course in finer()
        ]

    return Candidate(
        cause,
        location,
        tuple(column for function in (*course.functions, *before) for column in make(function)),
        depends_on,
        course.setting,
        refine=refine if finer else None,
        elsewhere=rebuild if elsewhere else None,
    )


def make_steps(
    facts: SessionFacts,
    cause: str,
    location: Location,
    make: Callable[[After], Sequence[Column]],
) -> Iterator[Candidate]:
    """Candidates for something that steps at an instant; *make*: the columns of that step."""

    def make_step(instant: float, finest: bool = False) -> Candidate:
        def refine() -> list[Candidate]:
            return [make_step(moment, True) for moment in facts.nearby_instants(instant)]

        return Candidate(
            cause,
            location,
            tuple(make(After(instant_unix_s=instant))),
            ("time_s",),
            (("instant", instant, "s (Unix)"),),
            refine=None if finest else refine,
        )

    return map(make_step, facts.instants_unix_s)


def list_courses(facts: SessionFacts) -> list[Course]:
    """Every course that the time seen allows; none without times."""
    since_s, until_s = facts.start_unix_s, facts.end_unix_s
    span_s = until_s - since_s
    if not facts.timed or span_s <= 0.0:
        return []
    hours = span_s / 3600.0
    line, squared_time = (
        Time(since_unix_s=since_s, until_unix_s=until_s, power=power) for power in (1, 2)
    )
    rate = Function("rate", "/h", hours, ((1.0, line),))
    bend = Function("bend", "/h²", hours**2, ((1.0, squared_time),))
    choices = [Course((rate,)), Course((rate, bend))]
    choices += [_relaxing(facts, share * span_s) for share in SHARES]
    if len(facts.spells_unix_s) > 1:
        longest_s = max(end - start for start, end in facts.spells_unix_s)
        choices += [_settling(facts, share * longest_s) for share in SETTLING_SHARES]
    if span_s > LEAST_DAYS * DAY_S:
        choices.append(Course(tuple(_daily(since_s, until_s))))
    if facts.spells_unix_s:
        choices.append(Course(tuple(_wandering(facts))))
    return choices


def _make_prior_functions(facts: SessionFacts) -> list[Function]:
    """What a drift had come to when the readings began, under a calibration from before. Courses
    begin at nothing: without it, whatever is as constant in the first session stands in for it."""
    if not facts.has_fixed_constants:  # the constants of the same sessions have it
        return []
    return [Function("before", "", 1.0, ((1.0, After(instant_unix_s=facts.start_unix_s)),))]


def _relaxing(facts: SessionFacts, time_constant_s: float, finest: bool = False) -> Course:
    basis = Relaxation(
        since_unix_s=facts.start_unix_s,
        until_unix_s=facts.end_unix_s,
        time_constant_s=time_constant_s,
    )
    return Course(
        (Function("in the end", "", 1.0, ((1.0, basis),)),),
        (("time constant", time_constant_s, "s"),),
        None if finest else lambda: [_relaxing(facts, time_constant_s * f, True) for f in FINER],
        lambda value: _relaxing(facts, value, True),
    )


def _settling(facts: SessionFacts, time_constant_s: float, finest: bool = False) -> Course:
    """From the beginning of each session again: what it came to is gone by the next."""
    pieces: list[tuple[float, Factor]] = []
    come_to = 0.0
    for start, end in facts.spells_unix_s:
        pieces.append((-come_to, After(instant_unix_s=start)))
        basis = Relaxation(since_unix_s=start, until_unix_s=end, time_constant_s=time_constant_s)
        pieces.append((1.0, basis))
        come_to = -math.expm1(-(end - start) / time_constant_s)
    return Course(
        (Function("in the end, each session", "", 1.0, tuple(pieces)),),
        (("time constant", time_constant_s, "s"),),
        None if finest else lambda: [_settling(facts, time_constant_s * f, True) for f in FINER],
        lambda value: _settling(facts, value, True),
    )


def _daily(since_s: float, until_s: float) -> Iterator[Function]:
    sine = Daily(kind="daily_sin", since_unix_s=since_s, until_unix_s=until_s)
    yield Function("sin of the day", "", 1.0, ((1.0, sine),))
    cosine = Daily(kind="daily_cos", since_unix_s=since_s, until_unix_s=until_s)
    yield Function("cos of the day", "", 1.0, ((1.0, cosine),))


def _wandering(facts: SessionFacts) -> Iterator[Function]:
    """A random walk: how far it comes from knot to knot, independently, along a line."""
    span_s = facts.end_unix_s - facts.start_unix_s
    for i, (since, until) in enumerate(_knots(facts), 1):
        hours = (until - since) / 3600.0
        line = Time(since_unix_s=since, until_unix_s=until)
        size = math.sqrt(span_s / (until - since))
        yield Function(f"walk {i}", "", size, ((1.0 / hours, line),))


def _knots(facts: SessionFacts) -> list[tuple[float, float]]:
    """From where to where, one after the other: each session, in pieces where these are few, and
    the time to the next."""
    spells = facts.spells_unix_s
    pieces = max(1, -(-LEAST_PIECES // (2 * len(spells) - 1)))
    knots: list[tuple[float, float]] = []
    for start, end in spells:
        if knots:
            knots.append((knots[-1][1], start))
        edges = [start + (end - start) * i / pieces for i in range(pieces + 1)]
        knots += itertools.pairwise(edges)
    return knots


#: How fine a course is looked at for the largest difference in it.
POINTS = 400


def is_drift(candidate: Candidate) -> bool:
    """Whether a candidate goes along a course rather than steps at an instant."""
    return any(isinstance(factor, Period) for factor in candidate.factors)


def is_walk(candidate: Candidate) -> bool:
    """Whether it wanders by chance, from knot to knot."""
    return is_drift(candidate) and any("walk" in column.name for column in candidate.columns)


def is_slow(candidate: Candidate) -> bool:
    """Whether what a candidate adds goes with time or with a temperature."""
    return any(isinstance(factor, SlowFactor) for factor in candidate.factors)


def describe_course(candidate: Candidate) -> str:
    """How a drift goes, in words."""
    names = [column.name for column in candidate.columns]
    time_constant = next(
        (value for name, value, _ in candidate.setting if "constant" in name), None
    )
    if time_constant is not None:
        anew = "settles anew in each session" if "session" in names[0] else "relaxes"
        return f"{anew} with a time constant of {format_plain(time_constant / 3600.0)} h"
    for word, description in (
        ("walk", "wanders"),
        ("day", "follows the time of day"),
        ("bend", "creeps in a curve"),
    ):
        if any(word in name for name in names):
            return description
    return "creeps steadily"


def compute_swing(candidate: Candidate, amplitudes: F64, parameter: str) -> float:
    """Largest less smallest of what a drift does to a parameter over the time seen."""
    weighted_factors = [
        (value * term.coefficient, term.basis[0])
        for column, value in zip(candidate.columns, amplitudes, strict=True)
        for term in column.terms
        if term.parameter == parameter
    ]
    periods = [f for _, f in weighted_factors if isinstance(f, Period)]
    since, until = (
        pick(t for f in periods for t in (f.since_unix_s, f.until_unix_s) if t is not None)
        for pick in (min, max)
    )
    times = np.linspace(since, until, POINTS)
    total = np.zeros(POINTS)
    for value, factor in weighted_factors:
        if isinstance(factor, Dated):
            total += value * factor.evaluate_at_times(times)
    return float(np.ptp(total))

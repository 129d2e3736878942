"""Courses in time of a drift, each made of a few functions with one beginning; and steps.

A course is steady, curved, relaxing, settling anew in each session, daily, or a random walk. Each
is weighed against steps at an instant, so that steps are reported only if there are steps.
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

OF_A_WALK = 1.0  # 1; deviation from a walk over the time seen, as a share of its range
OF_A_COURSE = 0.3  # 1; deviation from a creep, which is never exactly exponential

#: Time constants, as shares of the time seen. With a shorter one all is over before much was
#: measured; with a longer one it is nearly a straight line. They increase by factors of two and are
#: refined in between.
SHARES = (1 / 96, 1 / 48, 1 / 24, 1 / 12, 1 / 6, 1 / 3, 2 / 3)
FINER = (0.6, 0.7, 0.8, 0.9, 1.1, 1.25, 1.4, 1.65)
#: Time constants of settling anew in each session, as shares of the longest session.
SETTLING_SHARES = (1 / 12, 1 / 6, 1 / 3, 2 / 3)
DAY_S = 86400.0
#: A daily course needs this many days; over less it looks like a curve.
LEAST_DAYS = 0.6
#: A walk has its knots at the ends of the sessions. If these are few, each session is divided into
#: pieces, a single session into this many.
LEAST_PIECES = 12


@dataclass(frozen=True)
class Function:
    """One function of time, a sum of weighted factors, with its largest value over the
    time seen.
    """

    name: str
    per: str  # unit by which its amplitude is divided: "", "/h", …
    largest: float
    pieces: tuple[tuple[float, Factor], ...]

    def terms(self, weights: Sequence[tuple[str, float]]) -> tuple[Term, ...]:
        """Return terms on parameters with *weights* that share the function's amplitude."""
        return tuple(
            term
            for share, factor in self.pieces
            for term in tie([(name, weight * share) for name, weight in weights], factor)
        )


@dataclass(frozen=True)
class Course:
    """One course: its functions, the scanned setting, and the course at other values of it."""

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
    """Yield candidates for a drift along each course; *make* makes a function's columns."""
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
    """Return candidates for a step at each instant; *make* makes the columns of a step."""

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
    """List every course that the time seen allows; none without times."""
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
    """Return the function of a drift's value at the first reading, under an earlier calibration.

    Courses begin at zero. Without this function, another effect that is constant in the first
    session would take its place.
    """
    if not facts.has_fixed_constants:  # the constants of the same sessions contain it
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
    """Make a course that relaxes anew from the beginning of each session.

    The value of one session is gone by the next.
    """
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
    """Yield the functions of a random walk: independent linear increments from knot to knot."""
    span_s = facts.end_unix_s - facts.start_unix_s
    for i, (since, until) in enumerate(_knots(facts), 1):
        hours = (until - since) / 3600.0
        line = Time(since_unix_s=since, until_unix_s=until)
        size = math.sqrt(span_s / (until - since))
        yield Function(f"walk {i}", "", size, ((1.0 / hours, line),))


def _knots(facts: SessionFacts) -> list[tuple[float, float]]:
    """Return the intervals between knots, in order: each session, divided if few, and each gap."""
    spells = facts.spells_unix_s
    pieces = max(1, -(-LEAST_PIECES // (2 * len(spells) - 1)))
    knots: list[tuple[float, float]] = []
    for start, end in spells:
        if knots:
            knots.append((knots[-1][1], start))
        edges = [start + (end - start) * i / pieces for i in range(pieces + 1)]
        knots += itertools.pairwise(edges)
    return knots


#: The number of points at which the range of a course is evaluated.
POINTS = 400


def is_drift(candidate: Candidate) -> bool:
    """Return whether a candidate follows a course rather than a step at an instant."""
    return any(isinstance(factor, Period) for factor in candidate.factors)


def is_walk(candidate: Candidate) -> bool:
    """Return whether a candidate is a random walk from knot to knot."""
    return is_drift(candidate) and any("walk" in column.name for column in candidate.columns)


def is_slow(candidate: Candidate) -> bool:
    """Return whether the terms of a candidate depend on time or on a temperature."""
    return any(isinstance(factor, SlowFactor) for factor in candidate.factors)


def describe_course(candidate: Candidate) -> str:
    """Describe the course of a drift in words."""
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
    """Compute the range (largest less smallest) of a drift's change of a parameter over the time
    seen.
    """
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

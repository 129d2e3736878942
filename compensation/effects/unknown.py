"""Structure that no cause of the catalogue has: a general basis, named by its variables.

The basis is motions of each joint's frame (its parameters) times functions of one variable, or of
two. It competes with the catalogue on equal terms. If it wins, the finding is `unknown` and states
only its variables.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

from armd.arrays import F64
from armd.compensation.effects import history, location, rolled
from armd.compensation.effects.effect import (
    AXES,
    Candidate,
    Column,
    Effect,
    SessionFacts,
    make_temperature,
    tie,
)
from armd.compensation.model.pose_factors import Angle, Approach, Harmonic, Rate, Side
from armd.compensation.model.slow_factors import TemperatureRate, Time
from armd.compensation.model.terms import Factor

#: A named cause with more columns than this is a curve.
MOST_NAMED = 6
TYPICAL = {"mm": 5e-3, "rad": 10e-6}


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        for name in ("theta", "d", "a", "alpha", "beta"):
            unit = "mm" if name in ("d", "a") else "rad"
            turning = k if name == "theta" else None
            for variables, functions in _functions(facts, turning):
                yield _candidate(k, name, unit, variables, functions, _general(variables))
    yield from history.list_candidates(facts)
    yield from rolled.list_candidates(facts)


_Function = tuple[str, str, float, tuple[Factor, ...]]  # label, unit, typical size, factors


def _candidate(
    joint: int,
    stem: str,
    unit: str,
    variables: tuple[str, ...],
    functions: Sequence[_Function],
    richer: Sequence[_Function] = (),
) -> Candidate:
    """Make a candidate of functions that belong together.

    *richer* are the functions of a richer candidate in the same variables.
    """
    parameter = f"{stem}_{joint}"
    columns = tuple(
        Column(
            f"{parameter} × {label}",
            f"{unit} × {per}" if per else unit,
            TYPICAL[unit] / size,
            tie([(parameter, 1.0)], *basis),
        )
        for label, per, size, basis in functions
    )

    def refine() -> Sequence[Candidate]:
        return [_candidate(joint, stem, unit, variables, richer)]

    place = location.parameter(joint, f"{parameter}({', '.join(variables)})")
    return Candidate("unknown", place, columns, variables, refine=refine if richer else None)


def _general(variables: tuple[str, ...]) -> list[_Function]:
    """Return a nearly free function of a joint's angle or rate, of two angles, or of rate and
    angle.

    The result is empty for other variables.
    """
    matches = [re.fullmatch(r"([qw])(\d+)", name) for name in variables]
    constant: _Function = ("", "", 1.0, ())
    match [(m[1], int(m[2])) for m in matches if m]:
        case [("w", k)]:
            return _of_the_rate(k)
        case [("q", j)]:
            return [wave for order in (1, 2, 3, 4) for wave in _waves(j, order)]
        case [("q", i), ("q", j)]:
            first, second = ([constant, *_waves(n, 1), *_waves(n, 2)] for n in (i, j))
            return _products(first, second)[1:]
        case [("w", k), ("q", j)]:
            return _products(_of_the_rate(k)[:2], [constant, *_waves(j, 1), *_waves(j, 2)])
    return []


def _products(first: Sequence[_Function], second: Sequence[_Function]) -> list[_Function]:
    return [
        (
            f"{a} {b}".strip(),
            per,
            size * other_size * (0.5 if first_factors and second_factors else 1.0),
            (*first_factors, *second_factors),
        )
        for a, per, size, first_factors in first
        for b, _, other_size, second_factors in second
    ]


def _of_the_rate(joint: int) -> list[_Function]:
    side, rate = Side(joint=joint), Rate(joint=joint)
    w = f"w{joint}"
    return [
        (f"side {joint}", "", 1.0, (side,)),
        (w, "s/rad", 0.1, (rate,)),
        (f"{w}·|{w}|", "s²/rad²", 0.05, (rate, rate, side)),
        (f"{w}^3", "s³/rad³", 0.05, (rate, rate, rate)),
        (f"|{w}|", "s/rad", 0.1, (rate, side)),
        (f"{w}^2", "s²/rad²", 0.05, (rate, rate)),
    ]


def _functions(
    facts: SessionFacts, turning: int | None
) -> Iterator[tuple[tuple[str, ...], list[_Function]]]:
    """Yield variables and their functions that belong together; a *turning* joint has
    pairs, too.
    """
    for j in facts.joints:
        yield (f"q{j}",), [*_waves(j, 1), *_waves(j, 2)]
        yield (f"q{j}",), [(f"q{j}^{n}", "", 1.0, (Angle(joint=j, power=n),)) for n in (2, 3)]
    for name in facts.sensors:
        for order in (1, 2):
            factor = make_temperature({name: 1.0}, order=order)
            yield (name,), [(f"ΔT({name})^{order}", "1/K", 5.0**order, (factor,))]
        if not facts.timed:
            continue
        rate = TemperatureRate(weights={name: 1.0}, smoothing_s=300.0)
        yield (name, "time_s"), [(f"d{name}/dt", "s/K", 1e-3, (rate,))]
    if facts.timed and turning is not None:
        elapsed, hours = _make_elapsed_time(facts)
        for j in facts.joints:
            grown = [
                (f"t {label}", "1/h", hours, (elapsed, *wave)) for label, _, _, wave in _waves(j, 1)
            ]
            yield (f"q{j}", "time_s"), grown
    if facts.rates:
        for j in facts.joints:
            yield (f"w{j}",), [(f"side {j}", "", 1.0, (Side(joint=j),))]
            yield (f"w{j}",), [(f"w{j}", "s/rad", 0.1, (Rate(joint=j),))]
    if facts.approach:
        variables = tuple(f"approach_{axis}" for axis in AXES)
        yield variables, [(f"approach {a}", "", 1.0, (Approach(axis=a),)) for a in AXES]
    if turning is not None:
        yield from _pairs(facts)
        if facts.rates:
            yield from _of_the_side(facts, turning)


def _make_elapsed_time(facts: SessionFacts) -> tuple[Time, float]:
    """Make the time since the first reading, and return the hours seen."""
    elapsed = Time(since_unix_s=facts.start_unix_s, until_unix_s=facts.end_unix_s)
    return elapsed, max((facts.end_unix_s - facts.start_unix_s) / 3600.0, 1e-6)


def _of_the_side(
    facts: SessionFacts, joint: int
) -> Iterator[tuple[tuple[str, ...], list[_Function]]]:
    """Yield functions of one joint's friction.

    It depends on another joint's angle, a temperature, the joint's rate, or the time in use.
    """
    of_the_rate = _of_the_rate(joint)
    if facts.timed:
        elapsed, hours = _make_elapsed_time(facts)
        side = Side(joint=joint)
        yield (f"w{joint}", "time_s"), [(f"t side {joint}", "1/h", hours, (elapsed, side))]
    yield (f"w{joint}",), [of_the_rate[2]]
    for j in facts.joints:
        if j != joint:
            for function in of_the_rate[:2]:
                yield (f"w{joint}", f"q{j}"), _products([function], _waves(j, 1))
    for name in facts.sensors:
        factor = make_temperature({name: 1.0})
        yield (f"w{joint}", name), _products(of_the_rate[:1], [(f"ΔT({name})", "", 5.0, (factor,))])


def _pairs(facts: SessionFacts) -> Iterator[tuple[tuple[str, ...], list[_Function]]]:
    for i, j in combinations(facts.joints, 2):
        product = (f"q{i}·q{j}", "", 1.0, (Angle(joint=i), Angle(joint=j)))
        yield (f"q{i}", f"q{j}"), [product]
        yield (f"q{i}", f"q{j}"), _products(_waves(i, 1), _waves(j, 1))
    for name in facts.sensors:
        factor = make_temperature({name: 1.0})
        for j in facts.joints:
            products = [
                (f"ΔT({name}) {label}", "1/K", 5.0, (factor, *wave))
                for label, _, _, wave in _waves(j, 1)
            ]
            yield (name, f"q{j}"), products


def _waves(joint: int, order: int) -> list[_Function]:
    return [
        (
            f"{kind} {order}q{joint}" if order > 1 else f"{kind} q{joint}",
            "",
            1.0,
            (Harmonic(kind=kind, joint=joint, order=order),),
        )
        for kind in ("sin", "cos")
    ]


def remove_name(candidate: Candidate, finding: Candidate) -> Candidate:
    """Return a candidate of a named cause as unknown, with columns named by their parameters.

    A curve over the turn and an unknown candidate are returned unchanged.
    """
    if candidate.cause == "unknown" or len(candidate.columns) > MOST_NAMED:
        return candidate
    columns = tuple(
        replace(column, name=f"{_moved(column)} × function {i}")
        for i, column in enumerate(candidate.columns, 1)
    )
    return replace(candidate, cause="unknown", columns=columns, depends_on=finding.depends_on)


def _moved(column: Column) -> str:
    if column.artefact is not None:
        return f"artefact {column.artefact.kind}"
    return ", ".join(dict.fromkeys(term.parameter for term in column.terms))


def describe(candidate: Candidate, _: F64) -> str:
    if candidate.location.origin is not None:
        cause, place = candidate.location.origin
        effect_name = f"{cause.replace('_', ' ')} ({place})"
        turning = " and ".join(candidate.depends_on)
        return f"{effect_name} is not quite of the catalogue's form: its size varies with {turning}"
    if candidate.looks_back:
        before = f"what joint {candidate.depends_on[0][1:]} did before a reading"
        return f"a structure in {before} that no cause of the catalogue has"
    return f"a structure in {', '.join(candidate.depends_on)} that no cause of the catalogue has"


EFFECT = Effect(
    "unknown",
    "something the catalogue does not know",
    "an effect of the catalogue whose form is incomplete",
    "vary the named variables one at a time",
    list_candidates,
    describe,
)

"""A lag, and exchanged sensors, beside what was found to go by these sensors."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from armd.arrays import F64
from armd.compensation.diagnose.fitting.refit import set_findings
from armd.compensation.diagnose.problem.acting_causes import (
    add_acting,
    find_acting,
    list_acting_through,
    update_candidate,
)
from armd.compensation.diagnose.problem.baseline import add_findings
from armd.compensation.diagnose.problem.linearise import linearise
from armd.compensation.diagnose.problem.signatures import compile_candidates, make_finding_columns
from armd.compensation.diagnose.scoring.candidates import PartedSurvey, score_candidates
from armd.compensation.diagnose.scoring.evidence import Scores, score
from armd.compensation.diagnose.scoring.projection import Projection, make_projection
from armd.compensation.diagnose.search.find_rival_sets import RivalSetSearch
from armd.compensation.diagnose.search.set_posterior import weigh_set
from armd.compensation.effects import catalogue
from armd.compensation.effects.effect import Candidate
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term
from support.found_problem import ARM, GRADIENT, Problem, fitted, measured, problem, problem_of

__all__ = ["problem"]  # the fixture

LAG_S = 480.0
EXPANSION = "link_expansion"
SOME = [(), (GRADIENT,), (GRADIENT, "joint_thermal", "encoder_thermal")]


def tip(problem: Problem, found: Any, states: States) -> F64:
    """(n, 3) where the arm with what was *found* is, its temperatures being those of *states*."""
    model = add_findings(problem.baseline.model, found.findings, found.amplitudes)
    values = compute_basis_values(model.terms, states, ARM, model.reference_c, model.constants)
    return compute_pose(states.q, compute_parameter_rows(model.constants, model.terms, values))[0]


def read(problem: Problem) -> States:
    return problem.rests.observations.states


def with_celsius(states: States, celsius: F64) -> States:
    return replace(states, temperature_c=celsius)


def late(problem: Problem) -> States:
    """Sensor t3 as link 3 follows it."""
    mean = Temperature(weights={"t3": 1.0}, lag_s=LAG_S, reference_c=0.0)
    term = Term(parameter="a_1", basis=[mean], coefficient=1.0)
    celsius = read(problem).temperature_c.copy()
    about = read(problem), ARM, 20.0, ARM.nominal()
    celsius[:, 2] = compute_basis_values([term], *about)[:, 0]
    return with_celsius(read(problem), celsius)


def lag(problem: Problem, value: float = LAG_S, link: int = 3) -> Candidate:
    every = catalogue.list_all_candidates(problem.facts)
    grid = next(c for c in every if c.place == ("thermal_lag", f"link {link}"))
    assert grid.elsewhere is not None
    return grid.elsewhere(value)


def exchange(problem: Problem) -> Candidate:
    """Of sensors t3 and t5."""
    place = ("sensor_swapped", "sensors t3, t5")
    return next(c for c in catalogue.list_all_candidates(problem.facts) if c.place == place)


def column(problem: Problem, found: Any, made: Candidate) -> F64:
    """(n, 3) of a candidate's first amplitude, about the arm with what was found."""
    model = add_findings(problem.baseline.model, found.findings, found.amplitudes)
    linear = linearise(problem.rests, model, ARM)
    return make_finding_columns(linear, [made], ARM)[0][: 3 * problem.rests.n, 0].reshape(-1, 3)


@pytest.mark.parametrize("causes", SOME)
def test_all_that_was_found_to_go_by_a_link_is_late_with_it(
    problem: Problem, causes: tuple[str, ...]
) -> None:
    found = problem.found(*causes)
    made = update_candidate(lag(problem), problem.facts, find_acting(found))
    assert made is not None
    expected = tip(problem, found, late(problem)) - tip(problem, found, read(problem))
    np.testing.assert_allclose(
        column(problem, found, made), expected, atol=1e-3 * np.abs(expected).max()
    )
    without = column(problem, found, lag(problem))
    short = np.abs(without - expected).max() > 0.1 * np.abs(expected).max()
    assert short == bool(causes)  # what the catalogue alone has of it


def test_a_lag_is_made_anew_at_its_own_time_constant(problem: Problem) -> None:
    found = problem.found(GRADIENT)
    made = update_candidate(lag(problem, 700.0), problem.facts, find_acting(found))
    assert made is not None
    assert made.setting == (("time constant", 700.0, "s"),)
    assert made.elsewhere is not None
    assert made.through == made.elsewhere(600.0).through == find_acting(found)
    again = update_candidate(made, problem.facts, ())
    assert again is not None
    assert again.columns == lag(problem, 700.0).columns


@pytest.mark.parametrize("cause", [EXPANSION, GRADIENT])
def test_beside_exchanged_sensors_what_goes_by_one_goes_by_the_other(
    problem: Problem, cause: str
) -> None:
    exchanged = exchange(problem)
    true = problem.found(cause)  # by the links' temperatures: by exchanged columns of what is read
    celsius = read(problem).temperature_c.copy()
    celsius[:, [2, 4]] = celsius[:, [4, 2]]
    expected = tip(problem, true, with_celsius(read(problem), celsius))
    nothing = problem.found()
    expected = expected - tip(problem, nothing, read(problem))
    other = {"t3": "t5", "t5": "t3"}
    sensors = [other.get(name, name) for name in true.findings[0].depends_on]
    (made,) = (
        c
        for c in catalogue.list_exchanged(problem.facts, exchanged)
        if c.place == true.findings[0].place
        and sorted(c.depends_on) == sorted(sensors)
        and len(c.columns[0].terms) == len(true.findings[0].columns[0].terms)
    )
    # Of a difference of sensors, the first less the second by name.
    size = true.amplitudes[0] * (1.0 if list(made.depends_on) == sensors else -1.0)
    linear = linearise(problem.rests, problem.baseline.model, ARM)
    own, others = make_finding_columns(linear, [exchanged, made], ARM)
    told = (own[:, 0] + others @ size)[: 3 * problem.rests.n].reshape(-1, 3)
    np.testing.assert_allclose(told, expected, atol=2e-3 * np.abs(expected).max())


@pytest.mark.slow
def test_it_goes_by_the_other_only_beside_the_exchange(problem: Problem) -> None:
    exchanged = exchange(problem)
    (turned,) = (
        c
        for c in catalogue.list_exchanged(problem.facts, exchanged)
        if c.place == (EXPANSION, "link 5") and len(c.columns[0].terms) == 1
    )
    assert turned.depends_on == ("t3",)
    with_it, without = fitted(problem, [exchanged]), fitted(problem, [])
    plain = compile_candidates([turned, exchanged], without.linear, ARM)
    scored = score_candidates(make_projection(with_it, ARM), plain)
    assert scored.scores.freedom[0] == 1
    assert scored.score_eligible_without(0).freedom[0] == 0
    assert score_candidates(make_projection(without, ARM), plain).scores.freedom[0] == 0
    more = add_acting(plain, with_it, problem.facts, (), ARM).candidates
    assert turned in more[2:]
    assert add_acting(plain, without, problem.facts, (), ARM) is plain
    assert fitted(problem, [exchanged, turned]).findings[1] is turned
    assert fitted(problem, [turned, lag(problem)]).findings[0].cause == "thermal_lag"


@pytest.mark.slow
def test_a_set_that_would_replace_another_has_what_acts_through_its_causes(
    problem: Problem,
) -> None:
    """A lag joins as it acts through the expansion that has joined, not through the one that was
    taken out with the set there is."""
    true = problem.found(EXPANSION)
    own = problem_of(measured(true))
    (expansion,) = own.found(EXPANSION).findings
    shift = next(c for c in catalogue.list_all_candidates(own.facts) if c.cause == "geometry_shift")
    lags = [lag(own, link=3), lag(own, link=5)]
    offered: dict[tuple[str, ...], list[Candidate]] = {}

    def choose(about: Projection, scores: Scores, _: int) -> Candidate | None:
        every = scores.signatures.candidates
        able = [c for c, alive in zip(every, scores.freedom > 0, strict=True) if alive]
        beside = tuple(c.cause for c in about.fit.findings)
        offered[beside] = [c for c in able if c.cause == "thermal_lag"]
        return None if beside else expansion

    for findings in ([shift], [expansion, shift]):
        last = fitted(own, findings)
        plain = compile_candidates([shift, expansion, *lags], last.linear, ARM)
        signatures = add_acting(plain, last, own.facts, (), ARM)
        parted = PartedSurvey.from_fit(set_findings(last, [], ARM), signatures, ARM)
        through = partial(list_acting_through, facts=own.facts, refused=())
        RivalSetSearch(
            parted.with_findings(last), parted, ARM, 100, choose, weigh_set, through
        ).find_rival_sets()
    for causes in ((), ("geometry_shift",)):
        assert {c.location for c in offered[causes]} == {c.location for c in lags}
        assert not any(c.through for c in offered[causes])
    of_link = [c for c in offered[(EXPANSION,)] if c.location == expansion.location]
    assert of_link
    assert len({c.setting for c in of_link}) == len(of_link)  # each time constant once
    for made in of_link:
        ((through_it,),) = (made.through,)
        assert through_it.candidate is expansion
        assert through_it.amplitudes[0] == pytest.approx(true.amplitudes[0][0], rel=0.01)


@pytest.mark.slow
def test_sums_of_more_candidates_are_those_of_one_pass_over_all(problem: Problem) -> None:
    own = problem_of(measured(problem.found(EXPANSION)))
    every = [*own.findings, lag(own), exchange(own)]  # of one column, and of two
    about = make_projection(fitted(own, []), ARM)
    some, rest = (
        about.sums(compile_candidates(c, about.fit.linear, ARM)) for c in (every[:2], every[2:])
    )
    whole = score(about.sums(compile_candidates(every, about.fit.linear, ARM)))
    put_together = score(some.with_more(rest))
    assert put_together.signatures.candidates == tuple(every)
    for name in ("statistic", "freedom", "log_evidence", "typical_snr"):
        np.testing.assert_allclose(getattr(put_together, name), getattr(whole, name), rtol=1e-9)

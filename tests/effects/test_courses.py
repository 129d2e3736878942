"""Courses in time against plain curves: how far they go, where they begin anew, what is told."""

from typing import Any

import numpy as np
import pytest

from armd.compensation.effects import courses, location
from armd.compensation.effects.courses import Course, Function
from armd.compensation.effects.effect import Candidate, Column
from armd.compensation.effects.encoder.encoder_slip import EFFECT as SLIP
from support.whole_scene import Whole, whole_scene


@pytest.fixture(scope="module")
def whole() -> Whole:
    return whole_scene()


@pytest.fixture(scope="module")
def found(whole: Whole) -> list[Course]:
    return courses.list_courses(whole.held)


def at(function: Function, time_s: np.ndarray) -> np.ndarray:
    return sum(share * factor.evaluate_at_times(time_s) for share, factor in function.pieces)


def called(found: list[Course], *names: str) -> list[Course]:
    return [course for course in found if tuple(f.name for f in course.functions) == names]


def moved(course: Course, *amplitudes: float) -> tuple[Candidate, np.ndarray]:
    """A course of one parameter with amplitudes, as a candidate has it."""
    columns = tuple(
        Column(f.name, "rad", 1.0, f.terms([("theta_1", 2.0)])) for f in course.functions
    )
    candidate = Candidate("any", location.joint(1), columns, ("time_s",), course.setting)
    return candidate, np.array(amplitudes)


def test_there_is_one_course_of_each_kind(whole: Whole, found: list[Course]) -> None:
    assert len(called(found, "rate")) == len(called(found, "rate", "bend")) == 1
    assert len(called(found, "in the end")) == len(courses.SHARES)
    assert len(called(found, "in the end, each session")) == len(courses.SETTLING_SHARES)
    assert len(called(found, "sin of the day", "cos of the day")) == 1
    untimed: Any = type("Facts", (), {"timed": False, "start_unix_s": 0.0, "end_unix_s": 1.0})()
    assert courses.list_courses(untimed) == []


def test_a_typical_size_is_of_the_whole_time_seen(whole: Whole, found: list[Course]) -> None:
    """Each function comes to 1 at `largest`: what its amplitude's typical size is divided by. Of a
    random walk, it is all steps together that do."""
    start, end = whole.held.start_unix_s, whole.held.end_unix_s
    ends = np.array([start, end])
    for course in (*called(found, "rate"), *called(found, "rate", "bend")):
        for function in course.functions:
            assert at(function, ends) == pytest.approx([0.0, function.largest])
    for course in called(found, "in the end"):
        far = np.array([start, start + 1e9])
        (function,) = course.functions
        share = course.setting[0][1] / (end - start)
        assert at(function, far)[1] == pytest.approx(1 - np.exp(-1 / share))
        assert np.abs(np.array(courses.SHARES) / share - 1).min() < 1e-12
    (walk,) = [course for course in found if course.functions[0].name == "walk 1"]
    steps = [np.ptp(at(f, ends)) / f.largest for f in walk.functions]
    assert np.sqrt(np.square(steps).sum()) == pytest.approx(1.0)


def test_a_walk_goes_from_knot_to_knot(whole: Whole, found: list[Course]) -> None:
    """Its steps follow each other: together, each by its hours, they are a straight line."""
    time_s = np.linspace(whole.held.start_unix_s, whole.held.end_unix_s, 500)
    (walk,) = [course for course in found if course.functions[0].name == "walk 1"]
    hours = [np.ptp(at(f, time_s)) for f in walk.functions]
    assert hours == pytest.approx([1.0] * len(hours)), "one unit each"
    spans = [f.pieces[0][1] for f in walk.functions]
    edges = [spans[0].since_unix_s, *(span.until_unix_s for span in spans)]
    assert edges == sorted(edges)
    assert {t for spell in whole.held.spells_unix_s for t in spell} <= set(edges)


def test_what_settles_begins_anew_in_each_session(whole: Whole, found: list[Course]) -> None:
    for course in called(found, "in the end, each session"):
        (function,) = course.functions
        for start, end in whole.held.spells_unix_s:
            time_s = np.linspace(start, end, 50)
            expected = 1 - np.exp(-(time_s - start) / course.setting[0][1])
            assert at(function, time_s) == pytest.approx(expected, abs=1e-12)


def test_the_same_at_other_values_of_the_scan(found: list[Course]) -> None:
    for course in found:
        assert (course.finer is None) == (course.elsewhere is None) == (not course.setting)
        if course.finer is not None and course.elsewhere is not None:
            name, seconds, _ = course.setting[0]
            finer = [other.setting[0][1] / seconds for other in course.finer()]
            assert finer == pytest.approx(courses.FINER)
            assert course.elsewhere(777.0).setting == ((name, 777.0, "s"),)


def test_how_far_it_goes_is_its_largest_less_its_smallest(
    whole: Whole, found: list[Course]
) -> None:
    hours = (whole.held.end_unix_s - whole.held.start_unix_s) / 3600
    (line,), (curve,) = called(found, "rate"), called(found, "rate", "bend")
    assert courses.compute_swing(*moved(line, 1e-6), "theta_1") == pytest.approx(2e-6 * hours)
    # up and down again: t − t²/h is h/4 at most, in the middle
    candidate, amplitudes = moved(curve, 1.0, -1.0 / hours)
    assert courses.compute_swing(candidate, amplitudes, "theta_1") == pytest.approx(
        hours / 2, rel=1e-4
    )


def test_a_drift_is_told_from_a_step_and_in_words(whole: Whole, found: list[Course]) -> None:
    assert not any(courses.is_drift(step) for step in SLIP.candidates(whole.held))
    told = {}
    for course in found:
        candidate, _ = moved(course)
        assert courses.is_drift(candidate)
        told[course.functions[-1].name.rstrip("0123456789 ")] = courses.describe_course(candidate)
    assert told["rate"] == "creeps steadily"
    assert told["bend"] == "creeps in a curve"
    assert told["walk"] == "wanders"
    assert told["cos of the day"] == "follows the time of day"
    assert told["in the end"].startswith("relaxes with a time constant of")
    assert told["in the end, each session"].startswith("settles anew in each session")

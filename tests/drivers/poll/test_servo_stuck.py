"""Servos that all say 0 or 1, wherever their shafts are."""

import pytest

from armd.drivers.joint_watch import GOOD_FOR_NS
from armd.drivers.poll.servos.stuck import StuckWatch


def looked(*cycles):
    watch = StuckWatch()
    return [watch.look(cycle) for cycle in cycles]


def test_from_one_cycle_to_the_next_they_are_stuck_until_they_say_something_else():
    here = [2048, 1800, 900]
    assert looked(here, [0, 1, 0], [1, 1, 0], here) == [False, True, True, False]


def test_they_may_be_stuck_from_the_beginning():
    assert looked([0, 1, 0]) == [True]


@pytest.mark.parametrize("gap", [[], [[None, None, None]]])
def test_an_arm_that_is_moved_there_is_not(gap):
    before = [4095, 3, 8]
    assert looked(before, [0, 1, 0], [0, 0, 0])[1:] == [False, False]
    assert looked(before, *gap, [0, 1, 0])[-1] is bool(gap)


def test_who_does_not_answer_says_nothing_of_the_others():
    assert looked([2048, 1800, 900], [0, 1, None]) == [False, False]


def test_it_is_told_once():
    watch = StuckWatch()
    watch.look([0, 0, 1])
    (event,) = watch.events(0)
    assert event.kind == "servos_stuck" and watch.hindrance == event.text
    watch.look([0, 1, 1])
    assert watch.events(1000) == []
    watch.look([2048, 2048, 2048])
    assert watch.events(2000) == []
    (event,) = watch.events(1000 + GOOD_FOR_NS)
    assert event.kind == "servos_valid" and watch.hindrance == ""

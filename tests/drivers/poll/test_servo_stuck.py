"""Servos that all say 0 or 1, wherever their shafts are."""

import pytest

from armd.drivers.joint_watch import GOOD_FOR_NS
from armd.drivers.poll.servos.stuck import StuckWatch

HERE, BESIDE_ZERO = [2048, 1800, 900], [4095, 3, 8]


@pytest.mark.parametrize(
    ("cycles", "stuck"),
    [
        ([HERE, [0, 1, 0], [1, 1, 0], HERE], [False, True, True, False]),
        ([[0, 1, 0]], [True]),  # from the beginning
        ([BESIDE_ZERO, [0, 1, 0], [0, 0, 0]], [False] * 3),  # moved there
        ([BESIDE_ZERO, [None] * 3, [0, 1, 0]], [False, False, True]),  # unless nobody saw it
        ([HERE, [0, 1, None]], [False, False]),  # a servo without an answer is no 0
    ],
)
def test_from_one_cycle_to_the_next_they_are_stuck_until_they_say_something_else(cycles, stuck):
    watch = StuckWatch()
    assert [watch.look(cycle) for cycle in cycles] == stuck


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

"""A servo that is a button: who waits for a press is told that it cannot be seen."""

from armd.drivers.config import Trigger
from armd.drivers.poll.servos.button import MISSING_AFTER_NS, Button

PRESSED, OPEN = {6: 1500, 1: 2048}, {6: 2300, 1: 2048}


def test_a_trigger_that_falls_silent_is_named_once_and_so_is_its_return():
    button = Button(Trigger(id=6, pressed_below=1900), "servo 6")
    assert button.look(PRESSED, 0) == (True, [])
    assert button.look(OPEN, 1) == (False, [])
    assert button.look({1: 2048}, 2) == (None, [])  # a single answer
    _, (event,) = button.look({1: 2048}, 2 + MISSING_AFTER_NS)
    assert event.kind == "trigger_missing" and event.severity == "error"
    assert event.text.startswith("servo 6, the trigger, does not answer")
    assert button.look({1: 2048}, 3 + MISSING_AFTER_NS) == (None, [])
    pressed, (event,) = button.look(PRESSED, 4 + MISSING_AFTER_NS)
    assert pressed and event.kind == "trigger_back"


def test_one_that_was_never_there_is_told_of_too():
    button = Button(Trigger(id=6, pressed_below=1900), "servo 6")
    assert button.look({1: 2048}, 0) == (None, [])
    assert [e.kind for e in button.look({1: 2048}, 2 * MISSING_AFTER_NS)[1]] == ["trigger_missing"]


def test_without_a_trigger_nothing_is_pressed():
    assert Button(None, "").look(PRESSED, 0) == (None, [])

"""Who waits for a press, or a rest, is told so."""

import json

import pytest
from test_measure_command import command  # noqa: F401

from armd.daemon.measure import waiting
from armd.daemon.measure.waiting import Waiting


@pytest.mark.parametrize(
    ("trigger", "what"), [("button", "press the arm's button"), ("rest", "hold it still")]
)
def test_it_is_said_after_20_s_once_a_wait(trigger, what):
    now = {"s": 0.0}
    waits = Waiting(trigger, lambda: now["s"])
    now["s"] = 19.9
    assert waits.take_reminder() == ""
    now["s"] = 20.0
    assert what in waits.take_reminder() and waits.take_reminder() == ""
    now["s"] = 30.0
    waits.over()
    now["s"] = 49.0
    assert waits.take_reminder() == ""
    now["s"] = 50.0
    assert what in waits.take_reminder()


def test_in_the_terminal(command, monkeypatch):  # noqa: F811
    monkeypatch.setattr(waiting, "PATIENCE_S", 0.2)
    arguments = ["seats", "--json", "--then", "none", "--seconds", "1"]
    _, lines, _ = command(*arguments)
    said = [json.loads(line) for line in lines]
    (told,) = [line for line in said if line["event"] == "waiting"]
    assert 'trigger = "rest"' in told["text"]

"""`armd measure` from its command line to the end, with a stand-in for the daemon; and kill -9."""

import argparse
import contextlib
import importlib
import json
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from test_measuring import ARM, BALLS, BEAM, IN_USE, at, press

import armd
from armd import keys
from armd.compensation.data.sessions.session import load_session
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import load_calibration
from armd.daemon.cli import main, name_module
from armd.daemon.measure import hearing, waiting
from armd.daemon.measure.ending import EndOptions, list_commands
from armd.daemon.measure.in_use import MeasuredWith
from armd.daemon.measure.log import NAME
from armd.daemon.measure.measuring import Measuring
from armd.daemon.measure.plan.kinds import make_plan
from armd.daemon.measure.plan.stations import Wishes
from armd.daemon.measure.waiting import Waiting
from support.small_arm import thermal_calibration

BEAM_TOML = '[artefact]\nname = "beam"\n' + "".join(
    f'[[artefact.target]]\nname = "{name}"\nposition_mm = {list(where)}\n'
    for name, where in BALLS.items()
)


class StandIn:
    """What a connection to a daemon does, as far as `armd measure` asks; plays *measurements*."""

    serial = ARM.serial_number

    def __init__(self, measurements, trigger="button"):
        self._measurements = measurements
        self._trigger = trigger

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def info(self):
        return {
            "arm": ARM.model_dump(mode="json", by_alias=True),
            "tip": None,
            "configuration": {"tips": {}, "measurement": {"trigger": self._trigger}},
        }

    def calibration_file(self):
        return None

    def past(self, _what):
        return []

    @contextlib.contextmanager
    def calling(self, what, callback):
        for measurement in self._measurements if what == keys.MEASUREMENT else ():
            callback(json.dumps(measurement).encode())
        yield


class Unheard(StandIn):
    """Its connection is gone from the begin on; there is one from the second look at its past on.
    What is pressed meanwhile, only its past has."""

    def __init__(self, before, measurements):
        super().__init__(())
        self._before, self._meanwhile = before, measurements
        self._asked = 0

    def past(self, _what):
        self._asked += 1
        return self._before if self._asked == 1 else [*self._before, *self._meanwhile]

    @contextlib.contextmanager
    def calling(self, what, callback):
        if what == keys.HEALTH:
            threading.Timer(0.6, callback, [b"{}"]).start()
        yield


@pytest.fixture
def command(monkeypatch, tmp_path, capsys):
    """Runs `armd measure`; its exit code and what it said, line by line."""
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    (tmp_path / "beam.toml").write_text(BEAM_TOML)

    def run(*arguments, measurements=(), trigger="button", arm=None):
        arm = arm or StandIn(measurements, trigger)
        monkeypatch.setattr(armd, "connect", lambda *_, **__: arm)
        code = main(["measure", *arguments, "-o", str(tmp_path / "session")])
        said = capsys.readouterr()
        return code, said.out.splitlines(), said.err

    return run


def test_an_artefact_is_measured_to_its_end(command, tmp_path):
    presses = [at(ball, i) for i, ball in enumerate(("B1", "B3", "B2", "B3"), 1)]
    beam = ["artefact", "--artefact", str(tmp_path / "beam.toml"), "--then", "none", "--json"]
    options = [*beam, "--placements", "P1", "--repeats", "1"]
    code, lines, _ = command(*options, measurements=presses)
    assert code == 0
    told = [json.loads(line) for line in lines]
    assert [line["event"] for line in told] == [
        *("begin", "reading", "refused", "reading", "reading", "end"),
    ]
    assert told[2]["reason"] == "too_far" and told[3]["next"]["target"] == "B3"
    assert told[-1]["finished"] and told[-1]["taken"] == 3
    session = load_session(tmp_path / "session", load_arm(tmp_path / "session" / "arm.toml"))
    assert session.n == 3 and session.placement_names == ["P1"]


def test_interrupted_it_goes_on_with_the_same_command(command, tmp_path):
    seats = ["seats", "--targets", "S1,S2", "--repeats", "2", "--then", "none", "--seconds", "0.2"]
    here, there = [400.0, 0.0, 50.0], [0.0, 400.0, 50.0]
    code, lines, _ = command(*seats, measurements=[press(1, here), press(2, there)])
    assert code == 1
    assert "2 of 4 done; the same command goes on" in lines[-1]
    code, lines, _ = command(*seats, measurements=[press(3, here), press(4, there)])
    assert code == 0 and "taken up again, 2 of 4 done" in lines[1]
    session = load_session(tmp_path / "session", ARM)
    assert [session.artefact.target_names[i] for i in session.target] == ["S1", "S2"] * 2


@pytest.mark.slow
def test_the_end_is_the_very_command(command, tmp_path):
    """Three readings calibrate no arm: `armd calibrate` says so, and its code is the answer."""
    presses = [at(ball, i) for i, ball in enumerate(BALLS, 1)]
    beam = ["artefact", "--artefact", str(tmp_path / "beam.toml"), "--json"]
    code, lines, _ = command(*beam, "--placements", "1", "--repeats", "1", measurements=presses)
    result = json.loads(lines[-2])
    assert code == result["code"] == 2
    assert result["command"].startswith("armd calibrate ") and "found" in result["error"]


def test_only_what_was_taken_at_the_trigger_counts(command):
    at_rest = press(1) | {"trigger": "rest"}
    seats = ["seats", "--repeats", "1", "--then", "none", "--json"]
    code, lines, _ = command(*seats, measurements=[press(2), at_rest], trigger="rest")
    assert code == 0
    assert [json.loads(line)["event"] for line in lines] == ["begin", "reading", "end"]


def test_what_was_pressed_unheard_is_taken_or_refused_when_the_arm_is_heard_again(
    command, monkeypatch
):
    """Three presses, the second as the arm has not moved; one of before the begin is no reading."""
    monkeypatch.setattr(hearing, "SILENT_S", 0.3)
    here, there = [400.0, 0.0, 50.0], [0.0, 400.0, 50.0]
    again = press(2, here) | {"seq": 2001, "stamp_ns": press(2)["stamp_ns"] + 1}
    arm = Unheard([press(1, here)], [press(2, here), again, press(3, there)])
    seats = ["seats", "--targets", "S1,S2", "--repeats", "1", "--then", "none", "--json"]
    code, lines, _ = command(*seats, arm=arm)
    assert code == 0
    told = [json.loads(line) for line in lines]
    events = ["begin", "silent", "heard", "reading", "refused", "reading", "end"]
    assert [line["event"] for line in told] == events
    assert told[2]["missed"] == 3 and told[4]["reason"] == "unmoved"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["artefact"], "--artefact: found nothing, expected a file: `artefact` wants one"),
        (["poses"], "--poses: found nothing"),
        (
            ["seats", "--sphere-mm", "25.4"],
            "--sphere-mm: found it with seats, expected it with tip",
        ),
        (["verify", "--tests", "spot"], "--tests: found 'spot', expected one of probing"),
        (["seats", "--then", "praise"], "--then: found 'praise', expected one of calibrate"),
        (["seats", "--with", "nowhere"], "nowhere/session.toml: the file: found nothing"),
    ],
)
def test_bad_usage(command, arguments, words):
    code, _, error = command(*arguments)
    assert code == 2 and words in error


@pytest.mark.parametrize(
    ("kind", "calibrated", "named"),
    [
        ("seats", False, ["calibrate"]),
        ("seats", True, ["diagnose"]),
        ("artefact", True, ["calibrate", "diagnose"]),
        ("verify", True, ["verify"]),
        ("tip", False, ["tip"]),
        ("interim", True, ["interim"]),
    ],
)
def test_each_kind_ends_with_a_command_that_there_is(tmp_path, kind, calibrated, named):
    calibration = thermal_calibration(ARM).content if calibrated else None
    in_use = MeasuredWith(ARM, calibration, "ab" * 8, None) if calibrated else IN_USE
    plan = make_plan(kind, ARM, BEAM if kind == "artefact" else None, Wishes())
    options = EndOptions(mpe=Path("mpe.toml"), history=Path("checks"), tip_name="ruby")
    with Measuring(tmp_path / kind, plan, in_use) as measuring:
        made = list_commands(measuring.folder, measuring.plan, measuring.in_use, options)
    assert [command[0] for command in made] == named
    for command in made:
        parser = argparse.ArgumentParser()
        importlib.import_module(name_module(command[0])).add_arguments(parser)
        parser.parse_args(command[1:])  # exits where an option is not one of the command's
    written = load_arm(tmp_path / kind / "arm.toml")
    assert written == ARM
    if calibrated:
        in_force = load_calibration(tmp_path / kind / "calibration_in_use.json", ARM).content
        assert in_force.constants == calibration.constants


@pytest.mark.parametrize(
    ("trigger", "what"), [("button", "press the arm's button"), ("rest", "hold it still")]
)
def test_who_waits_for_a_press_or_a_rest_is_told_after_20_s_once_a_wait(trigger, what):
    now = {"s": 0.0}
    waits = Waiting(trigger, lambda: now["s"])
    now["s"] = 19.9
    assert waits.take_reminder() == ""
    now["s"] = 20.0
    assert what in waits.take_reminder() and waits.take_reminder() == ""
    now["s"] = 30.0
    waits.restart()
    now["s"] = 49.0
    assert waits.take_reminder() == ""
    now["s"] = 50.0
    assert what in waits.take_reminder()


def test_who_waits_is_told_in_the_terminal(command, monkeypatch):
    monkeypatch.setattr(waiting, "PATIENCE_S", 0.2)
    arguments = ["seats", "--json", "--then", "none", "--seconds", "1"]
    _, lines, _ = command(*arguments)
    said = [json.loads(line) for line in lines]
    (told,) = [line for line in said if line["event"] == "waiting"]
    assert 'trigger = "rest"' in told["text"]


TAKER = """
import json, sys
from pathlib import Path
sys.path[:0] = {paths!r}
from test_measuring import IN_USE, beam_plan
from armd.daemon.measure.measuring import Measuring
measuring = Measuring(Path(sys.argv[1]), beam_plan(placements=["P1"], repeats=100), IN_USE)
for line in sys.stdin:
    print(measuring.offer(json.loads(line))["number"], flush=True)
"""


@pytest.mark.slow
def test_killed_at_any_moment_nothing_that_was_told_is_lost(tmp_path):
    folder = tmp_path / "beam"
    here = Path(__file__).parent
    code = TAKER.format(paths=[str(here), str(here.parents[1])])
    command = [sys.executable, "-c", code, str(folder)]
    with subprocess.Popen(command, stdin=-1, stdout=-1, text=True) as taker:
        asked = iter(range(1, 300))
        names = list(BALLS)
        end_s = None
        told = 0
        while end_s is None or time.monotonic() < end_s:
            number = next(asked)
            taker.stdin.write(json.dumps(at(names[(number - 1) % 3], number)) + "\n")
            taker.stdin.flush()
            told = int(taker.stdout.readline())
            end_s = end_s or time.monotonic() + 0.2
        # One more is on its way, and may be taken, torn, or not there at all.
        taker.stdin.write(json.dumps(at(names[told % 3], told + 1)) + "\n")
        taker.stdin.flush()
        taker.send_signal(signal.SIGKILL)
    assert told > 1
    with Measuring.resume(folder, IN_USE) as measuring:
        taken = measuring.state()["taken"]
        assert taken in (told, told + 1)
    session = load_session(folder, ARM)
    assert session.n == taken
    np.testing.assert_array_equal(session.target, np.arange(taken) % 3)
    assert len((folder / NAME).read_text().splitlines()) == 1 + taken

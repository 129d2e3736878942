"""Servos that others met in the field (tests/field), through the doctor and the whole daemon."""

import json
import os
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path

import pytest

from armd import Flag
from support.program import run_armd
from support.running_daemon import running_daemon
from support.selection import parametrize_default

FIELD = Path(__file__).parents[1] / "field"


@contextmanager
def quirky_servos(name, folder, family, **environment):
    command = [sys.executable, str(FIELD / name / "quirk_servo.py"), "--servo", family]
    command += ["--arm-out", "arm.toml", "--link", "port", "--seconds", "60"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, cwd=folder, env=os.environ | environment
    ) as servos:
        try:
            assert servos.stdout.readline()
            yield folder / "port"
        finally:
            servos.terminate()


@contextmanager
def measuring(folder, port, family):
    with (
        running_daemon(
            folder, str(port), driver="ids = [1, 2, 3, 4, 5]", kind=family,
            environment={"STATE_DIRECTORY": str(folder / "state")},
        ) as daemon,
        daemon.listen() as heard,
    ):  # fmt: skip
        yield heard


@parametrize_default("family", ["dynamixel", "feetech"])
def test_of_servos_that_all_say_zero_no_point_leaves(family, tmp_path):
    now = tmp_path / "now"
    with (
        quirky_servos("servo-all-zero", tmp_path, family, STUCK_WHEN=str(now)) as port,
        measuring(tmp_path, port, family) as heard,
    ):
        heard.wait_for(lambda: (heard.points()["flags"] & Flag.INVALID == 0).sum() > 50)
        now.touch()
        heard.wait_for(lambda: heard.events("servos_stuck"))
        why = "NOT_READY: no valid point: every servo's position: found 0 or 1"
        heard.wait_for(lambda: heard.reason().startswith(why))
        points = heard.points()
    (event,) = heard.events("servos_stuck")
    valid = points[(points["flags"] & Flag.INVALID) == 0]
    assert int(valid["monotonic_ns"][-1]) < event["monotonic_ns"]


@pytest.mark.slow
@parametrize_default("family", ["feetech", "dynamixel"])
def test_servos_that_know_no_sync_read_are_read_one_by_one(family, tmp_path):
    """The doctor and the event blame neither cable nor supply, and tell the rate that results."""
    with quirky_servos("servo-no-sync-read", tmp_path, family) as port:
        doctor = run_armd("doctor", "--port", port, "--json")
        with measuring(tmp_path, port, family) as heard:
            heard.wait_for(lambda: heard.events("no_sync_read"))
            heard.wait_for(lambda: heard.reason().startswith("READY"))
            heard.wait_for(lambda: (heard.points()["flags"] & Flag.INVALID == 0).sum() > 100)
            (event,) = heard.events("no_sync_read")
    assert doctor.returncode == 1, doctor.stderr
    assert '"no_sync_read"' in doctor.stdout and '"lost_answers"' not in doctor.stdout
    assert "servos 1 to 6: no answer to a sync read" in doctor.stdout
    assert "reads the servos of this line one by one" in doctor.stdout
    assert json.loads(doctor.stdout)["ports"][0]["rate_hz"] > 0
    assert "not the cable" in event["text"] and event["detail"]["rate_hz"] > 0
    assert not heard.events("servo_missing")

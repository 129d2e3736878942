"""Arms of five and of nine servos through every command that is fed by a daemon: watched, measured,
recorded, and replayed bit by bit."""

import json
import re
import signal
import subprocess
import sys

import numpy as np
import pytest
from test_servo_daemon import INVALID, measuring

from armd import Flag
from support.fake_servos import Dynamixel, FakeServos, Feetech

ARMD = [sys.executable, "-m", "armd.daemon.cli"]
BUTTON = 20


def run(*words):
    return subprocess.run([*ARMD, *map(str, words)], capture_output=True, text=True, timeout=120)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("family", "ids"),
    [
        pytest.param(Feetech, (1, 2, 3, 4, 5), id="five-feetech"),
        pytest.param(Dynamixel, (1, 2, 3, 4, 5, 7, 8, 9, 12), id="nine-dynamixel"),
    ],
)
def test_watched_measured_recorded_and_replayed(tmp_path, family, ids):
    recording = tmp_path / "arm.mcap"
    trigger = f"rate_hz = 100\ntrigger = {{ id = {BUTTON}, pressed_below = 1900 }}\n"
    with (
        FakeServos(family, tmp_path, (*ids, BUTTON)) as servos,
        measuring(servos, tmp_path, ids, trigger) as (daemon, heard),
    ):
        heard.wait_for(lambda: len(heard.points()) > 20)
        to_file = ["record", "--endpoint", daemon.endpoint, "-o", str(recording)]
        with subprocess.Popen([*ARMD, *to_file], stdout=subprocess.PIPE, text=True) as recorder:
            assert recorder.stdout is not None
            assert "recording" in recorder.stdout.readline()
            for step in range(10):  # all joints, a count or two each time
                for servo in ids:
                    servos.move(servo, 2048 + 2 * step)
                mark = len(heard.points()) + 2
                heard.wait_for(lambda mark=mark: len(heard.points()) > mark)
            at_rest = int(Flag.AT_REST)
            heard.wait_for(lambda: heard.points()["flags"][-1] & at_rest)
            servos.move(BUTTON, 1500)
            heard.wait_for(lambda: heard.json("measurement"))
            servos.move(BUTTON, 2300)
            servos.move(ids[0], 2100)  # what is compared begins after 1.5 s
            end_ns = heard.points()["monotonic_ns"][-1] + 2_500_000_000
            heard.wait_for(lambda: heard.points()["monotonic_ns"][-1] > end_ns)
            recorder.send_signal(signal.SIGINT)
            out, _ = recorder.communicate(timeout=60)
        assert recorder.returncode == 0, out
        watched = run("watch", "--json", "--seconds", "1", "--endpoint", daemon.endpoint)
        measurement = heard.json("measurement")[0]
        assert daemon.stop()[0] == 0
    assert watched.returncode == 0, watched.stderr
    told = [json.loads(line) for line in watched.stdout.splitlines()]
    assert told
    angles_rad = np.array(measurement["angles_rad"])
    assert angles_rad.shape == (len(ids),)
    assert np.allclose(angles_rad, 18 * 2 * np.pi / 4096)
    assert measurement["flags"] & INVALID == 0
    checked = run("replay", recording, "--check")
    assert checked.returncode == 0, checked.stdout + checked.stderr
    assert int(re.search(r"(\d+) points bit-identical, 0 different", checked.stdout)[1]) > 50

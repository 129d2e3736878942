"""What the state says of an arm that warms up, and of one outside its calibration's range."""

from __future__ import annotations

import signal
from itertools import groupby
from pathlib import Path

import pytest

from armd import Flag
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import save_calibration
from support.drawn import drawn
from support.running_daemon import running_daemon
from support.simulated_arm import simulated_arm

CALIBRATED = 'calibration = "calibration.json"'
#: 20 K in a minute: a drift that no default limit lets pass
WARMING = ["--warm-up-k", "20", "--warm-up-s", "60"]


def calibrate(folder: Path, low_c: float, high_c: float) -> None:
    arm = load_arm(folder / "arm.toml")
    ranges = dict.fromkeys(arm.sensors, (low_c, high_c))
    save_calibration(folder / "calibration.json", drawn(arm, temperature_range_c=ranges))


def test_outside_its_range_it_is_inaccurate_until_calibrated_for_it(tmp_path: Path) -> None:
    with simulated_arm(tmp_path, "--ambient-c", "30", rate_hz=200) as arm:
        calibrate(tmp_path, 15.0, 25.0)
        with running_daemon(tmp_path, arm.port, top=CALIBRATED) as daemon, daemon.listen() as heard:
            heard.wait_for(lambda: "INACCURATE: outside the identified" in heard.reason())
            assert heard.points()["flags"][-1] & Flag.TEMPERATURE_RANGE
            calibrate(tmp_path, 15.0, 35.0)
            daemon.process.send_signal(signal.SIGHUP)
            heard.wait_for(lambda: heard.reason() == "READY: measuring")
            assert not heard.points()["flags"][-1] & Flag.TEMPERATURE_RANGE
        # A busy machine may let the clock go in between, or hear an event too late: DEGRADED.
        told = [message["state"] for message in heard.json("health")]
        of_the_range = [state for state in told if state in ("INACCURATE", "READY")]
        assert [state for state, _ in groupby(of_the_range)] == ["INACCURATE", "READY"]


@pytest.mark.slow
def test_a_drift_is_told_and_flagged_beyond_its_limit(tmp_path: Path) -> None:
    with simulated_arm(tmp_path, *WARMING, rate_hz=200) as arm:
        calibrate(tmp_path, -50.0, 150.0)
        limits = "[limits]\ntemperature_rate_k_per_h = 1e6\n"
        with (
            running_daemon(tmp_path, arm.port, top=CALIBRATED, extra=limits) as daemon,
            daemon.listen() as heard,
        ):
            heard.wait_for(lambda: "drifts by" in heard.reason())
            assert heard.reason().startswith("WARMING")
            assert not heard.points()["flags"][-1] & Flag.TEMPERATURE_RATE
            daemon.stop()
        with running_daemon(tmp_path, arm.port, top=CALIBRATED) as daemon, daemon.listen() as heard:
            heard.wait_for(lambda: "INACCURATE: temperature changes too fast" in heard.reason())
            assert heard.points()["flags"][-1] & Flag.TEMPERATURE_RATE

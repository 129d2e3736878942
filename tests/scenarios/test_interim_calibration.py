"""From daily checks to a running daemon: it takes the calibration that the history wrote."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from support.running_daemon import Heard, running_daemon
from support.simulated_arm import simulated_arm

SEED, SLIP = "6", "encoder_slip@joint 3=60"
EXTRA = '[interim]\nhistory = "history"\n[commands]\nenabled = true\n'
POINTS = 1000


def armd(*words: str | Path) -> int:
    command = [sys.executable, "-m", "armd.daemon.cli", *map(str, words)]
    return subprocess.run(command, stdout=subprocess.DEVNULL, check=False).returncode


def from_now_on(heard: Heard) -> np.ndarray:
    """The next points."""
    begin = len(heard.points())
    heard.wait_for(lambda: len(heard.points()) >= begin + POINTS)
    return heard.points()[begin : begin + POINTS]


def off_um(points: np.ndarray, truth: np.ndarray) -> float:
    """RMS distance of points to the simulator's own tips, µm; apart from a rigid motion, for where
    the base stands no calibration knows."""
    known = np.searchsorted(truth["seq"], points["seq"])
    assert (truth["seq"][known] == points["seq"]).all()
    tip = truth["position_mm"][known]
    shown, tip = points["position_mm"] - points["position_mm"].mean(axis=0), tip - tip.mean(axis=0)
    turn, _ = Rotation.align_vectors(tip, shown)
    off = turn.apply(shown) - tip
    return 1e3 * float(np.sqrt((off**2).sum(axis=1).mean()))


@pytest.mark.slow
def test_the_daemon_takes_the_calibration_that_a_history_of_checks_wrote(tmp_path: Path) -> None:
    """The arm slips, the checks say so and the daemon is INACCURATE; with `calibration_from` it is
    READY, and its points are where the tip is."""
    made, checks = tmp_path / "made", tmp_path / "checks"
    assert armd("simulate", "--session", "calibration", "-o", made, "--seed", SEED) == 0
    calibration = tmp_path / "calibration.json"
    files = ("--arm", made / "arm.toml")
    assert armd("calibrate", *sorted(made.glob("T*")), *files, "-o", calibration) == 0
    words = ("--session", "interim", "--days", "12", "--seed", SEED, "--plant", f"{SLIP}@8")
    assert armd("simulate", *words, "-o", checks) == 0
    history, files = tmp_path / "history", (*files, "--calibration", calibration)
    assert armd("interim", "add", *sorted(checks.glob("day-*")), *files, "--history", history) == 1
    (change,) = json.loads((history / "report.json").read_text())["changes"]
    assert (change["cause"], change["location"]) == ("encoder_slip", "joint 3")

    top = 'calibration = "calibration.json"'
    with (
        simulated_arm(tmp_path, "--seed", SEED, "--plant", SLIP, rate_hz=100) as arm,
        running_daemon(tmp_path, arm.port, EXTRA, top) as daemon,
        daemon.listen() as heard,
    ):
        heard.wait_for(lambda: heard.json("health"))
        heard.wait_for(lambda: "encoder slip, joint 3" in heard.json("health")[-1]["reason"])
        assert heard.json("health")[-1]["state"] == "INACCURATE"
        before = from_now_on(heard)

        shutil.copy(history / change["calibration_from"], calibration)
        assert daemon.get("command/reload")[0]
        heard.wait_for(lambda: heard.points()["calibration"][-1] != before["calibration"][-1])
        heard.wait_for(lambda: heard.json("health")[-1]["state"] == "READY")
        after = from_now_on(heard)
        assert daemon.stop()[0] == 0
        arm.stop()  # its truth is whole then
    wrong, right = (off_um(points, arm.truth()) for points in (before, after))
    print(f"off by {wrong:.1f} µm, with {change['calibration_from']} by {right:.1f} µm")
    assert right < 0.3 * wrong

"""Commands at a running daemon: the read-out without points and without a reader, tips, reload."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest
from running_daemon import Daemon, running_daemon
from simulated_arm import SimulatedArm, simulated_arm

import armd
from armd import ArmdError

ARMD = [sys.executable, "-m", "armd.daemon.cli"]
CONFIG = "[commands]\nenabled = true\n[tips.ruby]\noffset_mm = [0.0, 0.0, 150.0]\n"


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[SimulatedArm, Daemon]]:
    folder = tmp_path_factory.mktemp("live")
    with simulated_arm(folder) as arm, running_daemon(folder, arm.port, CONFIG) as daemon:
        yield arm, daemon


def run(daemon: Daemon, *words: str) -> subprocess.CompletedProcess[str]:
    command = [*ARMD, *words, "--endpoint", daemon.endpoint]
    return subprocess.run(command, capture_output=True, text=True, timeout=60)


def test_a_tip_and_a_reload_by_command(live: tuple[SimulatedArm, Daemon]) -> None:
    _, daemon = live
    done = run(daemon, "tip", "ruby")
    assert (done.returncode, done.stdout, done.stderr) == (0, "SIM-0001: tip ruby\n", "")
    with armd.connect(endpoint=daemon.endpoint) as arm:
        assert arm.info()["tip"] == "ruby"
        assert arm.command("tip", name="") == "the calibration's tip"
        assert arm.command("tip", name="ruby") == "tip ruby"
        with pytest.raises(ArmdError, match="expected no semicolon"):
            arm.command("tip", name="a;b")
    assert run(daemon, "tip", "-", "SIM-0001").stdout == "SIM-0001: the calibration's tip\n"
    refused = run(daemon, "tip", "glass")
    assert refused.returncode == 2
    assert "no tip 'glass'; there are: ruby" in refused.stderr
    assert run(daemon, "reload").stdout == "SIM-0001: nominal geometry\n"


def test_a_reader_that_has_seen_enough_ends_the_read_out(
    live: tuple[SimulatedArm, Daemon],
) -> None:
    _, daemon = live
    command = [*ARMD, "watch", "--json", "--endpoint", daemon.endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as watch:
        assert watch.stdout is not None and watch.stderr is not None
        assert watch.stdout.readline().startswith(b"{")
        watch.stdout.close()
        assert watch.stderr.read() == b""
        assert watch.wait(30) == 0


def test_the_read_out_outlives_silence(live: tuple[SimulatedArm, Daemon]) -> None:
    arm, daemon = live
    arm.process.send_signal(signal.SIGSTOP)
    try:
        done = run(daemon, "watch", "--seconds", "1")
    finally:
        arm.process.send_signal(signal.SIGCONT)
    assert (done.returncode, done.stderr) == (0, "")
    assert "0 points/s" in done.stdout

"""Commands at a running daemon: the read-out without points and without a reader, tips, reload."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

import armd
from armd import ArmdError
from support.program import ARMD, run_armd
from support.running_daemon import Daemon, running_daemon
from support.simulated_arm import SimulatedArm, simulated_arm

CONFIG = "[commands]\nenabled = true\n[tips.ruby]\noffset_mm = [0.0, 0.0, 150.0]\n"


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[SimulatedArm, Daemon]]:
    folder = tmp_path_factory.mktemp("live")
    with simulated_arm(folder) as arm, running_daemon(folder, arm.port, CONFIG) as daemon:
        yield arm, daemon


def run(daemon: Daemon, *words: str) -> subprocess.CompletedProcess[str]:
    return run_armd(*words, "--endpoint", daemon.endpoint)


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
        with pytest.raises(ArmdError, match="reload"):
            arm.command("dance")

    assert run(daemon, "tip", "-", "SIM-0001").stdout == "SIM-0001: the calibration's tip\n"
    refused = run(daemon, "tip", "glass")
    assert refused.returncode == 2
    assert "no tip 'glass'; there are: ruby" in refused.stderr
    assert run(daemon, "reload").stdout == "SIM-0001: nominal geometry\n"


def test_a_tip_calibrated_now_is_in_force_and_stays_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    more = CONFIG + "[measurement]\nlog = false\n"
    keep = {"name": "ruby", "offset_mm": "0.25,0.0,150.5", "radius_mm": "1.5"}
    with simulated_arm(tmp_path) as simulated:
        with (
            running_daemon(tmp_path, simulated.port, more) as daemon,
            armd.connect(endpoint=daemon.endpoint) as arm,
            daemon.listen() as heard,
        ):
            assert arm.info()["configuration"]["tips"]["ruby"]["offset_mm"] == [0.0, 0.0, 150.0]
            assert arm.command("keep_tip", **keep) == "tip ruby, as it was calibrated now"
            info = arm.info()
            assert info["tip"] == "ruby"
            ruby = {"offset_mm": [0.25, 0.0, 150.5], "radius_mm": 1.5}
            assert info["configuration"]["tips"] == {"ruby": ruby}
            heard.wait_for(lambda: heard.events("tip") and heard.events("tip_moved"))
            assert heard.events("tip")[0]["detail"] == {"tip": "ruby", **ruby}
            warned = heard.events("tip_moved")[0]["text"]  # √(0.25² + 0.5²)
            assert warned == "the tip 'ruby' moved by 0.559 mm, more than 0.1 mm"
            n = len(heard.json("measurement"))
            heard.wait_for(lambda: len(heard.json("measurement")) > n)
            measured = heard.json("measurement")[-1]
            told = measured["tip"], measured["tip_offset_mm"], measured["tip_radius_mm"]
            assert told == ("ruby", [0.25, 0.0, 150.5], 1.5)
            for wrong, said in (
                ({"offset_mm": "1,2"}, "offset_mm"),
                ({"offset_mm": "1,2,nan"}, "offset_mm"),
                ({"offset_mm": "1,2,1e9"}, "offset_mm"),
                ({"radius_mm": "-1"}, "radius_mm"),
                ({"name": "-"}, "a name of 80 letters"),
            ):
                with pytest.raises(ArmdError, match=said):
                    arm.command("keep_tip", **keep | wrong)
            assert arm.info()["configuration"]["tips"] == {"ruby": ruby}
        with (
            running_daemon(tmp_path, simulated.port, more) as daemon,
            armd.connect(endpoint=daemon.endpoint) as arm,
        ):
            assert arm.info()["configuration"]["tips"] == {"ruby": ruby}
        # Who writes another offset into armd.toml means it.
        edited = more.replace("150.0", "151.0")
        with (
            running_daemon(tmp_path, simulated.port, edited) as daemon,
            armd.connect(endpoint=daemon.endpoint) as arm,
        ):
            tips = arm.info()["configuration"]["tips"]
            assert tips["ruby"]["offset_mm"] == [0.0, 0.0, 151.0]


@pytest.mark.slow
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
        assert watch.wait(60) == 0


@pytest.mark.slow
def test_the_read_out_outlives_silence(live: tuple[SimulatedArm, Daemon]) -> None:
    arm, daemon = live
    arm.process.send_signal(signal.SIGSTOP)
    try:
        done = run(daemon, "watch", "--seconds", "1")
    finally:
        arm.process.send_signal(signal.SIGCONT)
    assert (done.returncode, done.stderr) == (0, "")
    assert "0 points/s" in done.stdout

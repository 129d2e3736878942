"""`armd record` and `armd replay`: what was published comes back, bit by bit."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest
from running_daemon import free_endpoint, running_daemon
from simulated_arm import simulated_arm

from armd.daemon.cli import main
from armd.drivers.recording import Recording
from armd.errors import BadInput

PATIENCE_S = 60.0


def start_recording(endpoint, path):
    command = [sys.executable, "-m", "armd.daemon.cli", "record", "--endpoint", endpoint]
    process = subprocess.Popen([*command, "-o", str(path)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert "recording" in process.stdout.readline()
    return process


def wait_until_grown(path, n_bytes):
    end_s = time.monotonic() + PATIENCE_S
    while path.stat().st_size < n_bytes:
        assert time.monotonic() < end_s, path.stat().st_size
        time.sleep(0.05)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording that ended well, one that was killed, and the points of the daemon's life."""
    folder = tmp_path_factory.mktemp("recording")
    whole, cut = folder / "whole.mcap", folder / "cut.mcap"
    with (
        simulated_arm(folder, rate_hz=500, link=True) as arm,
        running_daemon(folder, arm.port) as daemon,
    ):
        first, second = (start_recording(daemon.endpoint, path) for path in (whole, cut))
        wait_until_grown(whole, 220_000)
        first.send_signal(signal.SIGINT)
        wait_until_grown(cut, 220_000)
        second.kill()
        out, _ = first.communicate(timeout=PATIENCE_S)
        second.communicate()
        assert first.returncode == 0, out
        assert "0 raw frames lost" in out
    return whole, cut


def topics(path):
    counted = {}
    for message in Recording(path).messages():
        counted[message.topic] = counted.get(message.topic, 0) + 1
    return counted


def test_everything_is_in_it(recorded):
    whole, _ = recorded
    counted = topics(whole)
    assert counted["/raw"] > 100 and counted["/point"] > 100 and counted["/health"] >= 1
    recording = Recording(whole)
    assert recording.info["arm"]["serial_number"] == "SIM-0001"
    assert recording.info["configuration"]["driver"]["kind"] == "serial"


def test_a_killed_recorder_leaves_a_readable_file(recorded):
    _, cut = recorded
    assert topics(cut)["/point"] > 100


def test_any_beginning_of_a_file_can_be_read(recorded, tmp_path):
    whole, _ = recorded
    data = whole.read_bytes()
    short = tmp_path / "short.mcap"
    for part in (0.999, 0.8, 0.55, 0.31):
        short.write_bytes(data[: int(part * len(data))])
        assert topics(short).get("/raw", 0) > 0


@pytest.mark.parametrize("which", [0, 1])
def test_a_replay_gives_the_recorded_points_again(recorded, which, capsys):
    assert main(["replay", str(recorded[which]), "--check"]) == 0
    identical = int(capsys.readouterr().out.split()[1])
    assert identical > 100


def test_a_replay_as_a_table(recorded, tmp_path):
    table = tmp_path / "points.csv"
    assert main(["replay", str(recorded[0]), "-o", str(table)]) == 0
    lines = table.read_text().splitlines()
    assert lines[0].startswith("seq,stamp_ns,x_mm") and len(lines) > 100


def test_another_file_is_refused(tmp_path):
    path = tmp_path / "no.mcap"
    path.write_bytes(b"this is not a recording")
    with pytest.raises(BadInput, match=r"expected a recording"):
        Recording(path)
    assert main(["replay", str(path), "--check"]) == 2
    with pytest.raises(BadInput, match="a recording"):
        Recording(tmp_path / "nothing.mcap")


def test_it_is_published_like_a_live_arm(recorded, tmp_path):
    endpoint = free_endpoint()
    command = [sys.executable, "-m", "armd.daemon.cli"]
    with subprocess.Popen(
        [*command, "replay", str(recorded[0]), "--listen", endpoint, "--speed", "0.1"],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ,
    ) as replay:
        assert replay.stdout is not None and "ready" in replay.stdout.readline()
        watched = subprocess.run(
            [*command, "watch", "--json", "--seconds", "3", "--endpoint", endpoint],
            capture_output=True,
            text=True,
            timeout=PATIENCE_S,
        )
        replay.terminate()
        assert replay.wait(PATIENCE_S) == 0
    points = [json.loads(line) for line in watched.stdout.splitlines()]
    assert len(points) > 10

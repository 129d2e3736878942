"""The daemon's life: clients, commands, reload, stopped subscribers, its end, what it refuses."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import armd
from armd import Flag
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import save_calibration
from support.drawn import drawn
from support.program import ARMD, run_armd
from support.punctuality import Punctuality
from support.running_daemon import Daemon, Heard, free_endpoint, running_daemon, write_config
from support.simulated_arm import SimulatedArm, simulated_arm

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "subscriber.py"
TIPS = """
[commands]
enabled = true
[tips.long]
offset_mm = [0.0, 0.0, 200.0]
"""


@dataclass
class Live:
    arm: SimulatedArm
    daemon: Daemon
    heard: Heard
    folder: Path

    def armd(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return run_armd(*arguments, "--endpoint", self.daemon.endpoint)

    def wait_for_calibration(self, sha256: str) -> None:
        """Until points carry it."""
        expected = int.from_bytes(bytes.fromhex(sha256)[:8], "little")
        self.heard.wait_for(lambda: int(self.heard.points()["calibration"][-1]) == expected)


def write_calibration(folder: Path, d_1_mm: float = 0.0) -> str:
    """A calibration that differs from the nominal geometry by *d_1_mm*; its SHA-256."""
    arm = load_arm(folder / "arm.toml")
    return save_calibration(folder / "calibration.json", drawn(arm, d_1_mm)).sha256


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    folder = tmp_path_factory.mktemp("live")
    with simulated_arm(folder) as arm:
        write_calibration(folder)
        top = 'calibration = "calibration.json"'
        with (
            running_daemon(folder, arm.port, extra=TIPS, top=top) as daemon,
            daemon.listen() as heard,
        ):
            heard.wait_for(lambda: len(heard.points()) > 500)
            yield Live(arm, daemon, heard, folder)


def test_a_small_client_can_read_the_info(live: Live) -> None:
    with armd.connect(endpoint=live.daemon.endpoint) as arm:
        file = arm.calibration_file()
        assert file is not None
        assert file.encode() == (live.folder / "calibration.json").read_bytes()
        info = arm.info()
    assert info["calibration"]["sha256"] == hashlib.sha256(file.encode()).hexdigest()
    assert file not in json.dumps(info)
    assert len(json.dumps(info)) < 16_000


@pytest.mark.serial
def test_the_ten_line_subscriber(live: Live, punctuality: Punctuality) -> None:
    command = [sys.executable, str(EXAMPLE), live.daemon.endpoint]
    with punctuality.watch() as machine:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    *points, last = done.stdout.splitlines()
    assert len(points) > 200
    assert all(" mm  " in line for line in points)
    seq = np.array([int(line.split()[0]) for line in points])
    assert last == f"lost: {(np.diff(seq) - 1).sum()}"  # no loss goes unreported
    machine.judge_gaps(seq, "the ten-line subscriber")


@pytest.mark.serial
def test_the_client_iterates_points_and_arrays(live: Live, punctuality: Punctuality) -> None:
    with armd.connect("SIM-0001", live.daemon.endpoint) as arm:
        # On a busy machine the clock may be mapped later than the first points come.
        point = next(point for point in arm.points() if point.flags & Flag.CLOCK == 0)
        assert point.valid
        with punctuality.watch() as machine:
            batches = list(arm.batches(seconds=0.5))
        seq = np.concatenate([batch["seq"] for batch in batches])
        assert len(seq) > 100
        machine.judge_gaps(seq, "batches")
        assert arm.info()["point"]["size"] == 136
        assert arm.info()["arm"]["serial_number"] == "SIM-0001"


def test_the_client_says_when_nobody_is_there(live: Live) -> None:
    for timeout_s in (0.3, 3.0, 30.0):  # a starved machine takes longer to reach the daemon
        with pytest.raises(armd.ArmdError) as said:
            armd.connect("OTHER", live.daemon.endpoint, timeout_s=timeout_s)
        if "no daemon answers" not in str(said.value):
            break
    assert "no arm OTHER within" in str(said.value)
    with pytest.raises(armd.ArmdError, match="no daemon answers"):
        armd.connect(endpoint=free_endpoint(), timeout_s=0.3)


def test_watch_prints_a_line_of_json_per_point(live: Live) -> None:
    done = live.armd("watch", "--json", "--seconds", "1")
    assert done.returncode == 0, done.stderr
    points = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(points) > 100
    assert points[0].keys() >= {"seq", "stamp_ns", "position_mm", "flags", "flag_names"}


def test_watch_shows_a_panel(live: Live) -> None:
    done = live.armd("watch", "SIM-0001", "--seconds", "1.5")
    assert done.returncode == 0, done.stderr
    assert "SIM-0001" in done.stdout and "points/s" in done.stdout


def test_status_for_people_and_scripts(live: Live) -> None:
    live.heard.wait_for(
        lambda: any(h["state"] in ("READY", "WARMING") for h in live.heard.json("health")[-1:])
    )
    done = live.armd("status")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith("SIM-0001  ")
    assert json.loads(live.armd("status", "--json").stdout)["rates"]["points_hz"] > 500
    nobody = subprocess.run(
        [*ARMD, "status", "--endpoint", free_endpoint()], capture_output=True, text=True
    )
    assert nobody.returncode == 2
    assert nobody.stderr.startswith("armd: tcp/127.0.0.1:")


def test_root_is_warned_of_everywhere(live: Live) -> None:
    is_root = os.geteuid() == 0
    assert live.heard.json("health")[-1]["as_root"] == is_root
    assert ("armd runs as root" in live.armd("status").stdout) == is_root
    assert ("runs_as_root: armd runs as root" in live.daemon.log.read_text()) == is_root
    with armd.connect(endpoint=live.daemon.endpoint) as arm:
        told = [event for event in arm.events(seconds=2.0) if event["kind"] == "runs_as_root"]
    assert len(told) == is_root


def test_health_says_what_a_person_wants_to_know(live: Live) -> None:
    live.heard.wait_for(lambda: live.heard.json("health"))
    health = live.heard.json("health")[-1]
    assert health.keys() >= {"state", "reason", "rates", "drops", "temperatures", "latency"}
    assert health["temperatures"].keys() == {"t1", "t2", "t3", "t4", "t5", "t6"}
    ok, asked = live.daemon.get("health")
    assert ok and asked["serial"] == "SIM-0001"


def test_late_subscribers_get_the_events_of_the_past(live: Live) -> None:
    with armd.connect(endpoint=live.daemon.endpoint) as arm:
        kinds = [event["kind"] for event in arm.events(seconds=2.0)]
    assert "identified" in kinds
    ok, event = live.daemon.get("event")
    assert ok and event.keys() >= {"kind", "text", "severity", "monotonic_ns", "stamp_ns"}


@pytest.mark.serial
def test_a_reload_takes_effect_between_two_samples(live: Live, punctuality: Punctuality) -> None:
    sha256 = write_calibration(live.folder, d_1_mm=10.0)
    # On a busy machine Zenoh may leave out some points just when a subscription begins.
    first = len(live.heard.points()) - 1
    with punctuality.watch() as machine:
        ok, reply = live.daemon.get("command/reload")
        live.wait_for_calibration(sha256)
    assert ok and sha256 in reply["done"]
    points = live.heard.points()[first:]
    machine.judge_gaps(points["seq"], "points beside a reload")
    changes = np.flatnonzero(np.diff(points["calibration"].astype(object)))
    assert len(changes) == 1
    step = points["position_mm"][changes[0] + 1] - points["position_mm"][changes[0]]
    np.testing.assert_allclose(step, [0, 0, 10], atol=2)
    assert live.heard.events("calibration")[-1]["text"].endswith(sha256)
    assert live.daemon.get("info")[1]["calibration"]["sha256"] == sha256


def test_a_bad_calibration_leaves_the_old_one_in_force(live: Live) -> None:
    path = live.folder / "calibration.json"
    good = path.read_text()
    identity = int(live.heard.points()["calibration"][-1])
    path.write_text(good.replace('"d_1": ', '"d_1": 1'))
    ok, reply = live.daemon.get("command/reload")
    assert not ok and "content_sha256" in reply
    live.heard.wait_for(lambda: live.heard.events("calibration_refused"))
    assert int(live.heard.points()["calibration"][-1]) == identity
    path.write_text(good)
    already = len(live.heard.events("calibration"))
    live.daemon.process.send_signal(signal.SIGHUP)
    live.heard.wait_for(lambda: len(live.heard.events("calibration")) > already)
    assert int(live.heard.points()["calibration"][-1]) == identity


def test_selecting_a_tip_warns_when_it_moved_far(live: Live) -> None:
    ok, reply = live.daemon.get("command/tip?name=long")
    assert ok and reply["done"] == "tip long"
    live.heard.wait_for(lambda: live.heard.events("tip_moved"))
    assert live.daemon.get("info")[1]["tip"] == "long"
    ok, reply = live.daemon.get("command/tip?name=short")
    assert not ok and reply == "no tip 'short'; there are: long"
    assert live.daemon.get("command/tip")[0]
    ok, reply = live.daemon.get("command/dance")
    assert not ok and "reload" in reply


@pytest.mark.serial
def test_a_stopped_subscriber_delays_nobody_else(live: Live, punctuality: Punctuality) -> None:
    with subprocess.Popen(
        [*ARMD, "watch", "--json", "--endpoint", live.daemon.endpoint], stdout=subprocess.PIPE
    ) as slow:
        assert slow.stdout is not None and slow.stdout.readline()
        slow.send_signal(signal.SIGSTOP)
        first = len(live.heard.points())
        with punctuality.watch() as machine:  # its buffers overflow within a second or two
            live.heard.wait_for(lambda: len(live.heard.points()) > first + 4000)
        points = live.heard.points()[first:]
        slow.kill()
    machine.judge_gaps(points["seq"], "a subscriber beside a stopped one")
    apart_s = np.diff(live.heard.arrived_ns["point"][first:]).max() * 1e-9
    machine.judge(apart_s, 1.0, "the longest wait for a point beside a stopped subscriber")


@pytest.mark.serial
def test_sigterm_ends_it_within_3_s_and_takes_the_token_away(
    live: Live, punctuality: Punctuality
) -> None:
    with live.daemon.session() as session:
        alive = f"armd/{live.daemon.serial}/alive"
        time.sleep(0.2)
        assert [reply for reply in session.liveliness().get(alive) if reply.ok]
        with punctuality.limit(3.0, "armd run ends after SIGTERM"):
            code, _ = live.daemon.stop()
        assert code == 0
        assert not [reply for reply in session.liveliness().get(alive) if reply.ok]


@pytest.mark.slow
def test_commands_are_refused_unless_enabled_and_a_killed_daemon_needs_no_cleaning(
    tmp_path: Path,
) -> None:
    endpoint = free_endpoint()
    with simulated_arm(tmp_path) as arm:
        with running_daemon(tmp_path, arm.port, endpoint=endpoint) as daemon:
            ok, reply = daemon.get("command/reload")
            assert not ok and reply.startswith("refused")
            daemon.stop(signal.SIGKILL)
        with (
            running_daemon(tmp_path, arm.port, endpoint=endpoint) as daemon,
            daemon.listen() as heard,
        ):
            heard.wait_for(lambda: len(heard.points()) > 200)
            assert not daemon.get("command/reload")[0]
            assert daemon.stop(signal.SIGINT)[0] == 0


@pytest.mark.slow
def test_a_foreign_arm_is_waited_out_or_ends_the_daemon(tmp_path: Path) -> None:
    with simulated_arm(tmp_path, "--serial-number", "OTHER-7", rate_hz=200) as arm:
        toml = (tmp_path / "arm.toml").read_text()
        (tmp_path / "arm.toml").write_text(toml.replace("OTHER-7", "SIM-0001"))
        with running_daemon(tmp_path, arm.port) as daemon, daemon.listen() as heard:
            heard.wait_for(lambda: heard.json("health"))
            past = daemon.get("event")[1]
            heard.wait_for(lambda: "OTHER-7" in heard.json("health")[-1]["reason"])
            health = heard.json("health")[-1]
            assert health["state"] == "NOT_READY"
            assert "found OTHER-7, expected SIM-0001" in health["reason"]
            assert past and len(heard.points()) == 0
            assert "found OTHER-7, expected SIM-0001" in daemon.log.read_text()
        config = write_config(tmp_path, arm.port, free_endpoint(), '[health]\nforeign_arm = "stop"')
        done = subprocess.run(
            [*ARMD, "run", str(config)], capture_output=True, text=True, timeout=60
        )
        assert done.returncode == 2
        assert "found OTHER-7, expected SIM-0001" in done.stderr.splitlines()[-1]


@pytest.mark.slow
def test_ready_does_not_wait_for_an_arm_that_is_not_there(tmp_path: Path) -> None:
    with simulated_arm(tmp_path, rate_hz=100, seconds=0.1) as arm:
        arm.wait()
    with running_daemon(tmp_path, str(tmp_path / "nothing")) as daemon, daemon.listen() as heard:
        heard.wait_for(lambda: heard.json("health"))
        assert heard.json("health")[-1]["state"] == "NOT_READY"
        assert daemon.stop()[0] == 0

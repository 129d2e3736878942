"""The daemon's life: clients, commands, reload, stopped subscribers, its end, what it refuses."""

from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
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
from support.simulated_arm import simulated_arm


@dataclass
class Live:
    daemon: Daemon
    heard: Heard
    folder: Path

    def armd(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return run_armd(*arguments, "--endpoint", self.daemon.endpoint)


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    folder = tmp_path_factory.mktemp("live")
    with simulated_arm(folder) as arm:
        save_calibration(folder / "calibration.json", drawn(load_arm(folder / "arm.toml")))
        top = 'calibration = "calibration.json"'
        with running_daemon(folder, arm.port, top=top) as daemon, daemon.listen() as heard:
            heard.wait_for(lambda: len(heard.points()) > 500)
            yield Live(daemon, heard, folder)


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


def test_watch_shows_a_panel_or_prints_a_line_of_json_per_point(live: Live) -> None:
    done = live.armd("watch", "SIM-0001", "--seconds", "1.5")
    assert done.returncode == 0, done.stderr
    assert "SIM-0001" in done.stdout and "points/s" in done.stdout
    done = live.armd("watch", "--json", "--seconds", "1")
    assert done.returncode == 0, done.stderr
    points = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(points) > 100
    assert points[0].keys() >= {"seq", "stamp_ns", "position_mm", "flags", "flag_names"}


def test_status_for_people_and_scripts(live: Live) -> None:
    live.heard.wait_for(
        lambda: any(h["state"] in ("READY", "WARMING") for h in live.heard.json("health")[-1:])
    )
    done = live.armd("status")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith("SIM-0001  ")
    health = json.loads(live.armd("status", "--json").stdout)
    assert health["rates"]["points_hz"] > 500
    assert health.keys() >= {"state", "reason", "drops", "latency"}
    assert health["temperatures"].keys() == {"t1", "t2", "t3", "t4", "t5", "t6"}
    nobody = subprocess.run(
        [*ARMD, "status", "--endpoint", free_endpoint()], capture_output=True, text=True
    )
    assert nobody.returncode == 2
    assert nobody.stderr.startswith("armd: tcp/127.0.0.1:")


def test_late_subscribers_get_the_past_and_root_is_warned_of_everywhere(live: Live) -> None:
    is_root = os.geteuid() == 0
    assert live.heard.json("health")[-1]["as_root"] == is_root
    assert ("armd runs as root" in live.armd("status").stdout) == is_root
    assert ("runs_as_root: armd runs as root" in live.daemon.log.read_text()) == is_root
    with armd.connect(endpoint=live.daemon.endpoint) as arm:
        kinds = [event["kind"] for event in arm.events(seconds=2.0)]
    assert "identified" in kinds and kinds.count("runs_as_root") == is_root
    ok, event = live.daemon.get("event")
    assert ok and event.keys() >= {"kind", "text", "severity", "monotonic_ns", "stamp_ns"}


@pytest.mark.serial
def test_a_stopped_subscriber_delays_neither_others_nor_the_end(
    live: Live, punctuality: Punctuality
) -> None:
    """Zenoh's close would wait for it. The last test of this fixture: the daemon is gone then."""
    alive = f"armd/{live.daemon.serial}/alive"
    watch = [*ARMD, "watch", "--json", "--endpoint", live.daemon.endpoint]
    with (
        live.daemon.session() as session,
        subprocess.Popen(watch, stdout=subprocess.PIPE) as slow,
    ):
        try:
            assert slow.stdout is not None and slow.stdout.readline().startswith(b"{")
            slow.send_signal(signal.SIGSTOP)
            first = len(live.heard.points())
            with punctuality.watch() as machine:  # its buffers overflow within a second or two
                live.heard.wait_for(lambda: len(live.heard.points()) > first + 4000)
            points = live.heard.points()[first:]
            assert [reply for reply in session.liveliness().get(alive) if reply.ok]
            with punctuality.limit(3.0, "armd run ends after SIGTERM beside a stopped subscriber"):
                code, _ = live.daemon.stop()
            assert code == 0
            assert not [reply for reply in session.liveliness().get(alive) if reply.ok]
        finally:
            slow.kill()
    machine.judge_gaps(points["seq"], "a subscriber beside a stopped one")
    apart_s = np.diff(live.heard.arrived_ns["point"][first : first + len(points)]).max() * 1e-9

    machine.judge(apart_s, 1.0, "the longest wait for a point beside a stopped subscriber")


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

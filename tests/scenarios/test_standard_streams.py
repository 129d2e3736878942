"""Standard error that is full, closed or not read, standard output too, and a signal that comes
early: the arm measures on, and the daemon ends when it is asked to."""

from __future__ import annotations

import os
import re
import select
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from support.punctuality import Punctuality
from support.running_daemon import Daemon, free_endpoint, write_config
from support.simulated_arm import SimulatedArm, simulated_arm
from support.waiting import PATIENCE_S

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
RUN = [sys.executable, "-m", "armd.daemon.cli", "run"]


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SimulatedArm]:
    # Drop-outs of a sensor, each told twice: missing and back.
    faults = [f"sensor_open@{k}:0.6" for k in range(2, 100)]
    options = [word for fault in faults for word in ("--fault", fault)]
    with simulated_arm(tmp_path_factory.mktemp("arm"), *options, rate_hz=500) as arm:
        yield arm


@contextmanager
def daemon_with(arm: SimulatedArm, folder: Path, redirect: str, errors: int) -> Iterator[Daemon]:
    """`armd run CONFIG REDIRECT` of a shell, standard error being *errors*."""
    endpoint = free_endpoint()
    (folder / "arm.toml").write_bytes(arm.arm_toml.read_bytes())
    config = write_config(folder, arm.port, endpoint)
    command = ["sh", "-c", f'exec "$0" "$@" {redirect}', *RUN, str(config)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=errors, text=True) as process:
        try:
            yield Daemon(process, endpoint, "SIM-0001", folder / "daemon.log")
        finally:
            process.kill()


def full_pipe() -> tuple[int, int]:
    """A pipe that nobody reads, with no room left."""
    read, write = os.pipe()
    os.set_blocking(write, False)
    with pytest.raises(BlockingIOError):
        while True:
            os.write(write, b"x" * 4096)
    os.set_blocking(write, True)
    return read, write


@pytest.mark.serial
@pytest.mark.parametrize(
    "redirect",
    [
        "1>&- 2>&-",
        pytest.param("", marks=pytest.mark.slow),
        pytest.param(">/dev/full 2>/dev/full", marks=pytest.mark.slow),
    ],
    ids=["closed", "not read", "full"],
)
def test_a_log_that_cannot_be_written_stops_nothing(
    arm: SimulatedArm, tmp_path: Path, redirect: str, punctuality: Punctuality
) -> None:
    read, write = full_pipe()
    try:
        with daemon_with(arm, tmp_path, redirect, write) as daemon:
            wait_until_it_listens(daemon)
            with daemon.listen() as heard:
                heard.wait_for(lambda: len(heard.points()) > 100)
                first = len(heard.points())
                with punctuality.watch() as machine:
                    heard.wait_for(lambda: heard.events("temperature_missing"))
                    seen = len(heard.points())
                    heard.wait_for(lambda: len(heard.points()) > seen + 100)
                machine.judge_gaps(heard.points()["seq"][first:], "points beside a full log")
                with punctuality.limit(3.0, "armd run ends after SIGTERM"):
                    code, _ = daemon.stop()
                assert code == 0
    finally:
        os.close(read)
        os.close(write)


def wait_until_it_listens(daemon: Daemon) -> None:
    host, port = daemon.endpoint.removeprefix("tcp/").split(":")
    end_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            socket.create_connection((host, int(port))).close()
            return
        except ConnectionRefusedError:
            assert time.monotonic() < end_s and daemon.process.poll() is None
            time.sleep(0.05)


def test_a_hang_up_before_it_is_ready_is_a_reload_and_not_the_end(
    arm: SimulatedArm, tmp_path: Path
) -> None:
    (tmp_path / "arm.toml").write_bytes(arm.arm_toml.read_bytes())
    endpoint = free_endpoint()
    config = write_config(tmp_path, arm.port, endpoint)
    with subprocess.Popen([*RUN, str(config)], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            while not is_handled(signal.SIGHUP, process.pid):  # the interpreter itself starts
                time.sleep(0.002)
            while not select.select([process.stdout], [], [], 0.01)[0]:
                process.send_signal(signal.SIGHUP)
            assert process.stdout.readline().startswith("armd: ready ")
        finally:
            process.kill()


def test_a_unit_starts_the_daemon_deaf_to_a_hang_up_from_its_first_instant(tmp_path: Path) -> None:
    """As systemd runs its line: whatever stands before the program, SIGHUP is ignored in it."""
    for unit in ("armd.service", "armd@.service"):
        (line,) = re.findall(r"^ExecStart=(.*)$", (DEPLOY / unit).read_text(), re.MULTILINE)
        words = line.split()
        words[words.index("/opt/armd/bin/armd") :] = ["/bin/sleep", "60"]
        with subprocess.Popen(words) as process:
            try:
                end_s = time.monotonic() + PATIENCE_S
                while not is_handled(signal.SIGHUP, process.pid):
                    assert time.monotonic() < end_s, f"{unit}: SIGHUP ends the program"
                    time.sleep(0.002)
                process.send_signal(signal.SIGHUP)
                time.sleep(0.05)
                assert process.poll() is None
            finally:
                process.kill()


def is_handled(number: signal.Signals, pid: int) -> bool:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    masks = [int(line.split()[1], 16) for line in lines if line.startswith(("SigIgn", "SigCgt"))]
    return any(mask >> (number - 1) & 1 for mask in masks)

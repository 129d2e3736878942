"""The template of docs/developer/plugins.md at work: its driver in `armd run`, its command beside
it; and a driver that fails in every `read`, which the daemon survives."""

from __future__ import annotations

import json
import math
import queue
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.other_packages import environment_with, install_template, make_package
from support.plain_kinematics import tip_pose
from support.program import ARMD, run_armd
from support.running_daemon import Daemon, free_endpoint
from support.waiting import PATIENCE_S

TURN = 1 << 20
ARM = (
    'schema = "armd.arm/1"\nserial_number = "UDP-1"\n'
    + 3 * f"[[joint]]\na_mm = 100.0\nalpha_deg = 90.0\ncounts_per_turn = {TURN}\n"
    + "[tip]\noffset_mm = [0, 0, 10]\n"
)
#: Opens, and then raises whenever it is read.
FAILING = """\
from armd.drivers.packets import SamplePacket, PacketDecoder, PacketDriver
from armd.drivers.plugin import DriverPlugin

class Decoder(PacketDecoder):
    def read_packet(self, data):
        return SamplePacket(0, [])

class Line(PacketDriver):
    def open(self):
        pass
    def receive(self, timeout_s):
        return {}["no such register"]
    def close(self):
        raise OSError("nor this")

class Failing(DriverPlugin):
    def make_driver(self, expectation):
        return Line(Decoder(expectation), "a line")
"""


@contextmanager
def daemon_with(packages: Path, folder: Path, driver: str, more: str = "") -> Iterator[Daemon]:
    endpoint = free_endpoint()
    (folder / "arm.toml").write_text(ARM)
    (folder / "armd.toml").write_text(
        f'schema = "armd.daemon/1"\narm = "arm.toml"\n[driver]\n{driver}\n'
        f'[zenoh]\nlisten = ["{endpoint}"]\n{more}\n'
    )
    environment = environment_with(packages) | {"STATE_DIRECTORY": str(folder / "state")}
    with (
        (folder / "daemon.log").open("w") as log,
        subprocess.Popen(
            [*ARMD, "run", str(folder / "armd.toml")],
            stdout=subprocess.PIPE, stderr=log, text=True, env=environment,
        ) as process,
    ):  # fmt: skip
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line.startswith("armd: ready UDP-1 "), (folder / "daemon.log").read_text()
            yield Daemon(process, endpoint, "UDP-1", folder / "daemon.log")
        finally:
            process.kill()


@contextmanager
def posted() -> Iterator[tuple[str, queue.Queue[dict[str, Any]]]]:
    """A server's address, and the objects that are posted to it."""
    bodies: queue.Queue[dict[str, Any]] = queue.Queue()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            bodies.put(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            pass

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/", bodies
        server.shutdown()
        thread.join()


def free_udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def counts_of(number: int) -> list[int]:
    """A slow motion over the seam of joint 1 for 200 samples, then rest."""
    turned = min(number, 200)
    return [(TURN - 10_000 + 100 * turned) % TURN, 50 * turned, 7]


def expected_mm(numbers: np.ndarray) -> np.ndarray:
    """The tip by plain matrices: the counts as angles, the first below half a turn."""
    counts = np.array([counts_of(int(number)) for number in numbers], float)
    counts[:, 0] = np.where(counts[:, 0] > TURN / 2, counts[:, 0] - TURN, counts[:, 0])
    q = counts * (2 * math.pi / TURN)
    by_joint = np.tile([0.0, 0.0, 100.0, math.pi / 2, 0.0], 3)
    parameters = np.concatenate([by_joint, [0.0, 0.0, 10.0], np.zeros(6)])
    return tip_pose(q, np.tile(parameters, (len(q), 1)))[:, :3, 3]


def test_the_template_s_driver_and_command_at_work(tmp_path: Path) -> None:
    packages = install_template(tmp_path)
    port = free_udp_port()
    driver, at_rest = f'kind = "udp"\nport = {port}', '[measurement]\ntrigger = "rest"'
    with (
        daemon_with(packages, tmp_path, driver, at_rest) as daemon,
        daemon.listen() as heard,
        posted() as (url, bodies),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as arm,
        subprocess.Popen(
            [*ARMD, "webhook", "UDP-1", "--endpoint", daemon.endpoint, "--url", url],
            stdout=subprocess.PIPE, text=True, env=environment_with(packages),
        ) as webhook,
    ):  # fmt: skip
        assert webhook.stdout is not None
        assert webhook.stdout.readline() == f"armd: ready webhook on {url}\n"
        for number in range(600):
            if number != 100:  # one that is lost
                packet = struct.pack("<I3I", number, *counts_of(number))
                arm.sendto(packet, ("127.0.0.1", port))
            if number == 50:  # once more, and torn
                arm.sendto(packet, ("127.0.0.1", port))
                arm.sendto(packet[:-1], ("127.0.0.1", port))
            time.sleep(0.002)
        heard.wait_for(lambda: len(heard.points()) == 599)
        measurement = bodies.get(timeout=PATIENCE_S)
        webhook.terminate()
        assert webhook.wait(PATIENCE_S) == 0
        heard.wait_for(lambda: heard.json("health")[-1]["drops"].get("samples") == 599)
        points, drops = heard.points(), heard.json("health")[-1]["drops"]
        assert daemon.stop()[0] == 0
    seq = points["seq"]
    assert seq.tolist() == [number for number in range(600) if number != 100]
    np.testing.assert_allclose(points["position_mm"], expected_mm(seq), atol=1e-9)
    assert seq[points["flags"] & (1 << 6) != 0].tolist() == [101]
    assert (points["flags"] & (1 << 8) != 0).all()  # its stamps are arrival times
    assert measurement["trigger"] == "rest" and measurement["serial"] == "UDP-1"
    np.testing.assert_allclose(measurement["position_mm"], expected_mm(np.array([599]))[0])
    assert [drops[what] for what in ("lost", "malformed", "repeated")] == [1, 1, 1]


def test_a_driver_that_always_fails_ends_no_daemon(tmp_path: Path) -> None:
    entry = "[armd.drivers]\nfailing = failing:Failing\n"
    packages = make_package(tmp_path / "packages", "failing", entry, FAILING)
    with (
        daemon_with(packages, tmp_path, 'kind = "failing"') as daemon,
        daemon.listen() as heard,
    ):
        heard.wait_for(lambda: len(heard.json("health")) > 2)
        assert daemon.get("info")[0] and daemon.process.poll() is None
        health = heard.json("health")[-1]
        assert health["state"] == "NOT_READY" and health["drops"]["reconnects"] > 2
        assert daemon.stop()[0] == 0
    log = daemon.log.read_text()
    told = "driver_failed: the driver failing failed and is opened again: KeyError: 'no such"
    assert log.count(told) == 1
    for error in ("KeyError: 'no such register'", "OSError: nor this"):  # of read, and of close
        assert log.count(f"driver failing: {error}\nTraceback") == 1


@pytest.mark.serial
@pytest.mark.slow
def test_a_recording_of_the_template_s_driver_is_replayed(tmp_path: Path) -> None:
    packages = install_template(tmp_path)
    port = free_udp_port()
    stop = threading.Event()

    def send() -> None:
        number = 0
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as arm:
            while not stop.wait(0.002):
                # To and fro: of a rest that began before the recording a replay cannot know.
                counts = counts_of(200 - abs(number % 400 - 200))
                arm.sendto(struct.pack("<I3I", number, *counts), ("127.0.0.1", port))
                number += 1

    def armd(*words: str) -> subprocess.CompletedProcess[str]:
        return run_armd(*words, env=environment_with(packages))

    recording = str(tmp_path / "recording.mcap")
    with daemon_with(packages, tmp_path, f'kind = "udp"\nport = {port}') as daemon:
        thread = threading.Thread(target=send)
        thread.start()
        done = armd("record", "--endpoint", daemon.endpoint, "--seconds", "2", "-o", recording)
        stop.set()
        thread.join()
    assert done.returncode == 0, done.stderr
    done = armd("replay", recording, "--check")
    assert done.returncode == 0, done.stdout + done.stderr
    packages.rename(tmp_path / "gone")
    done = armd("replay", recording, "--check")
    assert done.returncode == 2 and "driver.kind: found 'udp', expected a kind" in done.stderr

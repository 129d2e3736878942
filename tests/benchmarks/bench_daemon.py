"""From the latch in a simulated arm to a subscriber, beside Zenoh alone; losses, CPU, start-up.

Two floors are measured in turn with it: Zenoh alone, the same 136 bytes put by one process at the
same rate and received by the same callback in this one; and the line alone, 40 bytes from one
process to another over a pseudo-terminal. The daemon's latency starts at the true latch in the
simulated arm, so it has both in it; `p50_ratio` is to Zenoh alone, `p50_ratio_to_floors` to the sum
of both. The daemon keeps the processors awake where it may (`armd.daemon.awake`), the floors are of
the machine as it is; `zenoh_alone_awake` is Zenoh alone with the processors kept awake for it too,
and `p50_ratio_awake` to that. `zenoh_beside_an_arm` is Zenoh alone on a machine that simulates an
arm as well, for nobody.
"""

from __future__ import annotations

import json
import os
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import serial
import zenoh
from running_daemon import Heard, free_endpoint, running_daemon
from simulated_arm import simulated_arm

from armd import Flag
from armd.compensation.arm import load_arm
from armd.compensation.calibration import save_calibration
from armd.compensation.known_expansion import known_expansion
from armd.daemon.awake import DEVICE, Awake

RATES_HZ = (1000, 5000)
#: The mark is 60 s at 5 kHz without a loss.
SECONDS = 60.0
BARE_SECONDS = 10.0
SETTLE_S = 5.0  # clock mapped, rates steady
CALIBRATION = 'calibration = "calibration.json"'


def run() -> dict[str, Any]:
    figures: dict[str, Any] = {"start": start_up()}
    for rate_hz in RATES_HZ:
        zenoh_us, line_us, through = zenoh_alone(rate_hz), line_alone(rate_hz), daemon(rate_hz)
        with processors_awake():
            awake_us = zenoh_alone(rate_hz)
        with an_arm_for_nobody(rate_hz):
            beside_us = zenoh_alone(rate_hz)
        for percentile in ("p50", "p99", "p99_9"):
            key = f"{percentile}_us"
            latency_us, floors_us = through["latency"][key], zenoh_us[key] + line_us[key]
            through[f"{percentile}_ratio"] = latency_us / zenoh_us[key]
            through[f"{percentile}_ratio_to_floors"] = latency_us / floors_us
            through[f"{percentile}_ratio_awake"] = latency_us / awake_us[key]
        figures[f"{rate_hz}_hz"] = {
            "zenoh_alone": zenoh_us,
            "line_alone": line_us,
            **through,
            "zenoh_alone_awake": awake_us,
            "zenoh_beside_an_arm": beside_us,
        }
    return figures


def start_up() -> dict[str, float]:
    """Seconds from the start of the process to its line `armd: ready`."""
    seconds = {}
    with tempfile.TemporaryDirectory() as folder, simulated_arm(Path(folder)) as arm:
        calibrate(arm.folder)
        cache = {"NUMBA_CACHE_DIR": f"{folder}/cache"}
        for state in ("cold_s", "warm_s"):
            start = time.monotonic()
            with running_daemon(arm.folder, arm.port, top=CALIBRATION, environment=cache) as daemon:
                seconds[state] = time.monotonic() - start
                daemon.stop()
    return seconds


def daemon(rate_hz: int) -> dict[str, Any]:
    """Latency from the true latch, losses and CPU of `armd run` at a rate."""
    with (
        tempfile.TemporaryDirectory() as folder,
        simulated_arm(Path(folder), rate_hz=rate_hz, seconds=SECONDS + 60) as arm,
    ):
        calibrate(arm.folder)
        with running_daemon(arm.folder, arm.port, top=CALIBRATION) as armd, armd.listen() as heard:
            time.sleep(SETTLE_S)
            first, cpu_s, start = (
                len(heard.payloads["point"]),
                _cpu_s(armd.process.pid),
                time.monotonic(),
            )
            goes_first = os.sched_getscheduler(armd.process.pid) != os.SCHED_OTHER
            time.sleep(SECONDS)
            cpu_s, elapsed_s = _cpu_s(armd.process.pid) - cpu_s, time.monotonic() - start
            last = len(heard.payloads["point"])
            points = heard.points()[first:last]
            arrived_ns = np.array(heard.arrived_ns["point"][first:last])
            latency_us = (arrived_ns - arm.latch_ns(points["seq"])) / 1000
            armd.stop()
    steps = np.diff(points["seq"].astype(np.int64))
    return {
        "latency": _percentiles(latency_us),
        "points": len(points),
        "lost": int((steps - 1).sum()),
        "flagged_lost": int(np.count_nonzero(points["flags"] & Flag.SAMPLES_LOST)),
        "cpu_percent_of_a_core": 100 * cpu_s / elapsed_s,
        "goes_first": goes_first,  # whether the system grants `armd.daemon.priority`
        "keeps_awake": os.access(DEVICE, os.W_OK),  # and `armd.daemon.awake`
        "cpu_ms_per_1000_samples": 1e3 * cpu_s / len(points) * 1000,
    }


@contextmanager
def processors_awake() -> Iterator[None]:
    """As the daemon keeps them, where the system lets us."""
    awake = Awake()
    awake.keep(True)
    try:
        yield
    finally:
        awake.keep(False)


@contextmanager
def an_arm_for_nobody(rate_hz: int) -> Iterator[None]:
    """A simulated arm whose line is read and thrown away."""
    with (
        tempfile.TemporaryDirectory() as folder,
        simulated_arm(Path(folder), rate_hz=rate_hz) as arm,
        subprocess.Popen(["cat", arm.port], stdout=subprocess.DEVNULL) as reader,
    ):
        yield
        reader.terminate()


def zenoh_alone(rate_hz: int) -> dict[str, float]:
    """Latency from put to callback of as many bytes at the same rate."""
    endpoint, key = free_endpoint(), "bare/point"
    script = Path(__file__).with_name("bare_put.py")
    command = [sys.executable, str(script), endpoint, key, str(rate_hz), str(BARE_SECONDS)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as sender:
        assert sender.stdout is not None
        sender.stdout.readline()
        config = zenoh.Config()
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("listen/endpoints", "[]")
        heard = Heard()
        with zenoh.open(config) as session:
            session.declare_subscriber(
                key,
                lambda sample: (
                    heard.arrived_ns["bare"].append(time.monotonic_ns()),
                    heard.payloads["bare"].append(sample.payload.to_bytes()),
                ),
            )
            sender.wait(BARE_SECONDS + 60)
    put_ns = np.frombuffer(b"".join(heard.payloads["bare"]), np.int64).reshape(-1, 17)[:, 0]
    latency_us = (np.array(heard.arrived_ns["bare"]) - put_ns) / 1000
    return _percentiles(latency_us[int(rate_hz) :])  # the first second settles


def line_alone(rate_hz: int) -> dict[str, float]:
    """Latency from a write to the end of a read in another process, over a pseudo-terminal."""
    script = Path(__file__).with_name("bare_line.py")
    command = [sys.executable, str(script), str(rate_hz), str(BARE_SECONDS)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as sender:
        assert sender.stdin is not None and sender.stdout is not None
        with serial.Serial(sender.stdout.readline().strip(), timeout=0) as port:
            poll = select.poll()
            poll.register(port.fileno(), select.POLLIN)
            sender.stdin.write("go\n")
            sender.stdin.flush()
            data = bytearray()
            arrived_ns: list[int] = []
            with suppress(OSError):  # the line breaks, or reads as ended, when all is sent
                while poll.poll(1000) and (chunk := os.read(port.fileno(), 1 << 16)):
                    data += chunk
                    now_ns = time.monotonic_ns()
                    arrived_ns += [now_ns] * (len(data) // 40 - len(arrived_ns))
    sent_ns = np.frombuffer(data, np.int64).reshape(-1, 5)[:, 0]
    return _percentiles((np.array(arrived_ns) - sent_ns)[int(rate_hz) :] / 1000)


def calibrate(folder: Path) -> None:
    """A calibration.json of known expansion beside the folder's arm.toml."""
    arm = load_arm(folder / "arm.toml")
    save_calibration(folder / "calibration.json", known_expansion(arm, [2e-6] * arm.n_joints))


def _percentiles(latency_us: npt.NDArray[np.float64]) -> dict[str, float]:
    p50, p99, p99_9 = np.percentile(latency_us, [50, 99, 99.9])
    return {"p50_us": float(p50), "p99_us": float(p99), "p99_9_us": float(p99_9)}


def _cpu_s(pid: int) -> float:
    """CPU seconds of a process, all its threads."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

"""Servo buses: cycles per second against what the line allows, and the processor they take.

The simulator paces its answers as the line would; what the line allows is its own arithmetic: the
bytes of request and answers, and the pause each servo needs before it answers. Servos wait for no
scheduler, so the simulated ones run at a real-time priority, above the driver's, which is that of
`armd run`; the bare client (`bare_servo.c`) is the least program that can ask for the same, on the
same line: what it does not reach is the pseudo-terminal's and this machine's. Nobody may be quicker
than the line: `..._busiest_hundred_of_the_line` is the quickest hundred cycles in a row.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from bench_daemon import processors_awake

from armd.daemon.host.priority import raise_priority
from armd.drivers.config import ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.poll.lateness import IN_DOUBT_NS
from armd.drivers.poll.protocol import dynamixel, feetech
from armd.drivers.table import open_driver
from armd.simulator.servobus.device import TURN_ROUND_NS
from support.simulated_arm import SimulatedArm, simulated_arm

SETTLING_S, SECONDS, BARE_SECONDS = 3.0, 60.0, 15.0
#: Real-time priority of the simulated servos, above the driver's.
SERVO_PRIORITY = 10
BAUD = 1_000_000
SERVOS = 6
IN_A_ROW = 100
BYTE_S = 10 / BAUD
#: A cycle that ends so late in a motion has no instant, and is left out (decision 12).
UNTIMED_S = 2 * IN_DOUBT_NS * 1e-9


def run() -> dict[str, Any]:
    """Of each family: six servos at 1 Mbaud for a minute, with the processors kept awake as
    `armd run` keeps them."""
    with at_the_daemons_priority(), processors_awake():
        return {family: _measure(family) for family in ("feetech", "dynamixel")}


@contextmanager
def at_the_daemons_priority() -> Iterator[None]:
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    raise_priority()
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


@contextmanager
def quick_arm(wire: str, *kind: str, folder: Path, seconds: float) -> Iterator[SimulatedArm]:
    """A simulated arm that waits for no scheduler, where the system grants that."""
    with simulated_arm(folder, wire=(wire, *kind), seconds=seconds) as arm:
        with suppress(PermissionError):
            param = os.sched_param(SERVO_PRIORITY)
            os.sched_setscheduler(arm.process.pid, os.SCHED_FIFO, param)
        yield arm


def _bare_client(family: str) -> np.ndarray | None:
    """The same requests by `bare_servo.c`; the periods of its cycles (n,) s, None without gcc."""
    if not shutil.which("gcc"):
        return None
    ids = range(1, SERVOS + 1)
    if family == "feetech":
        asked = [feetech.make_sync_read(ids, 56, n) for n in (2, 3)]
        sizes = [SERVOS * feetech.compute_status_size(n) for n in (2, 3)]
    else:
        asked = [dynamixel.make_fast_sync_read(ids, 132, n) for n in (4, 5)]
        sizes = [dynamixel.compute_fast_status_size(SERVOS, n) for n in (4, 5)]
    turns = [
        text for n, request in zip(sizes, asked, strict=True) for text in (str(n), request.hex())
    ]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        client = folder / "bare_servo"
        source = Path(__file__).with_name("bare_servo.c")
        subprocess.run(["gcc", "-O2", str(source), "-o", str(client)], check=True)
        with quick_arm("--servo", family, folder=folder, seconds=BARE_SECONDS + 30.0) as arm:
            command = [client, arm.port, str(BARE_SECONDS), *turns]
            told = subprocess.run(
                command, check=True, capture_output=True, preexec_fn=raise_priority
            )
    return np.frombuffer(told.stdout, float)


def _line_hz(family: str) -> float:
    """The mean of two cycles in a row, of which one asks for a byte more."""
    pause_s = TURN_ROUND_NS[family] * 1e-9
    if family == "feetech":
        asked, answers = 8 + SERVOS, [SERVOS * feetech.compute_status_size(n) for n in (2, 3)]
        pauses_s = SERVOS * pause_s
    else:  # by one fast read
        asked = 14 + SERVOS
        answers = [dynamixel.compute_fast_status_size(SERVOS, n) for n in (4, 5)]
        pauses_s = pause_s
    return 1 / ((asked + sum(answers) / 2) * BYTE_S + pauses_s)


def _measure(family: str) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["STATE_DIRECTORY"] = str(folder)
        seconds = SETTLING_S + SECONDS + 30.0
        with quick_arm("--servo", family, folder=folder, seconds=seconds) as arm:
            config = ServoConfig.model_validate(
                {
                    "kind": family, "port": arm.port, "baud": BAUD, "ids": [1, 2, 3, 4, 5],
                    "temperature_ids": [2, 3, 4, 5, 6],
                    "trigger": {"id": 6, "pressed_below": 1900},
                }
            )  # fmt: skip
            expected = Expectation("SIM-0001", 5, 5, (4096,) * 5)
            with closing(open_driver(config, expected)) as driver:
                _take(driver, SETTLING_S)
                before, cpu_s = driver.counters, time.process_time()
                rows, took_s = _take(driver, SECONDS)
                cpu_s = time.process_time() - cpu_s
                after = driver.counters
    line_hz = _line_hz(family)
    hz, periods_s = len(rows) / took_s, np.diff(rows) * 1e-9
    return {
        "cycles_hz": hz,
        "line_allows_hz": line_hz,
        **_of_the_line("", periods_s, line_hz),
        "of_the_line": hz / line_hz,
        **_of_a_bare_client(family, hz, line_hz),
        "lost": float(after["lost"] - before["lost"]),
        "of_these_untimed": float(after["untimed"] - before["untimed"]),  # somebody stood still
        "answers_missed": float(after["missed"] - before["missed"]),
        "cpu_s_per_1000_cycles": cpu_s / len(rows) * 1000,
    }


def _of_a_bare_client(family: str, hz: float, line_hz: float) -> dict[str, float]:
    periods_s = _bare_client(family)
    if periods_s is None:
        return {}
    late = np.count_nonzero(periods_s > 1 / line_hz + UNTIMED_S)
    return {
        **_of_the_line("bare_client_", periods_s, line_hz),
        "of_a_bare_client": hz * float(periods_s.mean()),
        "bare_client_as_late_as_untimed_a_minute": late * 60 / float(periods_s.sum()),
    }


def _of_the_line(whose: str, periods_s: np.ndarray, line_hz: float) -> dict[str, float]:
    """The share of the line that all cycles reach, those where nobody else runs (the quickest
    tenth), and the quickest `IN_A_ROW`, of pairs of cycles, as one of two asks for a byte more."""
    pairs_s = (periods_s[:-1] + periods_s[1:]) / 2
    in_a_row_s = np.convolve(periods_s, np.full(IN_A_ROW, 1 / IN_A_ROW), "valid")
    return {
        f"{whose}of_the_line": 1 / float(periods_s.mean()) / line_hz,
        f"{whose}quickest_tenth_of_the_line": 1 / float(np.quantile(pairs_s, 0.1)) / line_hz,
        f"{whose}busiest_hundred_of_the_line": 1 / float(in_a_row_s.min()) / line_hz,
    }


def _take(driver: Any, seconds: float) -> tuple[np.ndarray, float]:
    """Instants of the rows (n,) ns, and how long it took."""
    began = time.perf_counter()
    instants: list[int] = []
    while time.perf_counter() - began < seconds:
        for item in driver.read(0.05):
            if isinstance(item, np.ndarray):
                instants += item["monotonic_ns"].tolist()
        driver.take_raw()
    return np.array(instants), time.perf_counter() - began

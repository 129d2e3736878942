"""A MicroScribe asked for each reading, and the same one streaming: readings per second, and by how
much their stamps miss the instant at which the simulated arm made them.

By turns, on one simulated line: 115 200 baud, a turn-round of 0.9 ms (the maker's "just under a
millisecond"), the delay in ticks of the arm's timer. A pseudo-terminal delays nothing; what a USB
adapter adds falls on each request and each reply, and on a stream once.
"""

from __future__ import annotations

import tempfile
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
from bench_servo import at_the_daemons_priority, quick_arm

from armd.drivers.config import MicroScribeConfig
from armd.drivers.microscribe.decoder import MicroScribeDecoder
from armd.drivers.table import open_driver
from support.microscribe import EXPECTED, held_against_truth

ROUNDS, SECONDS, HOMED_S = 3, 15.0, 15.0


def run() -> dict[str, Any]:
    MicroScribeDecoder(EXPECTED).warm_up()
    with at_the_daemons_priority():
        rounds = [{way: _measure(way == "streamed") for way in ("asked", "streamed")}
                  for _ in range(ROUNDS)]  # fmt: skip
    return {
        way: {name: float(np.median([each[way][name] for each in rounds])) for name in figures}
        for way, figures in rounds[0].items()
    }


def _measure(stream: bool) -> dict[str, float]:
    with tempfile.TemporaryDirectory() as name:
        seconds = HOMED_S + SECONDS + 5.0
        with quick_arm("--microscribe", folder=Path(name), seconds=seconds) as arm:
            config = MicroScribeConfig(
                kind="microscribe", port=arm.port, baud=115_200, stream=stream
            )
            with closing(open_driver(config, EXPECTED)) as driver:
                deadline = time.monotonic() + HOMED_S
                while driver.hindrance or not driver.counters["samples"]:
                    driver.read(0.05)
                    if time.monotonic() > deadline:
                        raise RuntimeError("the simulated arm was not homed")
                until = time.monotonic() + 1.0  # it streams
                while time.monotonic() < until:
                    driver.read(0.05)
                rows, cpu_s = [], time.process_time()
                until = time.monotonic() + SECONDS
                while time.monotonic() < until:
                    rows += [i for i in driver.read(0.05) if isinstance(i, np.ndarray)]
                cpu_s = time.process_time() - cpu_s
                lost = driver.counters["lost"]
            arm.stop()
            samples = np.concatenate(rows)
            _, error_mm, late_ms = held_against_truth(arm, samples)
    took_s = np.ptp(samples["monotonic_ns"]) * 1e-9
    off_ms = np.abs(late_ms[error_mm < 0.5])
    return {
        "readings_hz": (len(samples) - 1) / took_s,
        "lost": float(lost),
        "stamp_off_p50_ms": float(np.quantile(off_ms, 0.5)),
        "stamp_off_p99_ms": float(np.quantile(off_ms, 0.99)),
        "cpu_s_per_1000_readings": cpu_s / len(samples) * 1000,
    }

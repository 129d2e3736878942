"""From the latch in a simulated arm to a subscriber, beside Zenoh alone; losses, CPU, start-up.

Two floors are measured in turn with it, with the same subscriber: Zenoh alone, the same 136 bytes
put by one process at the same rate; and the line alone, 40 bytes from one process to another over a
pseudo-terminal. The daemon's latency starts at the true latch in the simulated arm, so it has both
in it; `p50_ratio` is to Zenoh alone, `p50_ratio_to_floors` to the sum of both. The daemon keeps the
processors awake where it may (`armd.daemon.host.awake`), the floors are of the machine as it is;
`zenoh_alone_awake` is Zenoh alone with the processors kept awake for it too, and `p50_ratio_awake`
to that.

A shared host takes the processors away now and then (`stolen_percent`), which makes the one or the
other late, or fills a port. So every figure is given twice: over all, and, under `undisturbed`,
over the seconds in which the host took at most a hundredth of one processor, for the daemon and for
its floors alike. Rounds are added until there is a minute of these, or three times as many rounds
as wanted. Which seconds they are is decided by what the host took and by nothing else.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from floors import F64, I64, Arrivals, Latencies, line_alone, zenoh_alone
from measured import processor_s, resident_mb
from stolen import Stolen

from armd import Flag
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import save_calibration
from armd.daemon.host.awake import DEVICE, Awake
from support.known_expansion import known_expansion
from support.running_daemon import running_daemon
from support.simulated_arm import SimulatedArm, simulated_arm

#: (Hz, rounds of all in turn): the mark for losses is 60 s at 5 kHz without one.
RATES = ((1000, 4), (5000, 1))
#: Of the daemon, and of each floor, in all rounds together.
SECONDS, FLOOR_SECONDS = 60.0, 20.0
ENOUGH_S = 59.0  # of undisturbed seconds: SECONDS, whose last ones may be cut
UNDISTURBED_S = 0.01  # the most that the host took in a second of all processors
MOST_ROUNDS = 3  # times as many as wanted
SETTLE_S = 5.0  # clock mapped, rates steady
#: Real-time priority of the simulated arm, above the daemon's.
LATCH_PRIORITY = 10
CALIBRATION = 'calibration = "calibration.json"'
#: What a daemon's start stands on.
BARE_START = "import numpy, serial, zenoh; zenoh.open(zenoh.Config()).close()"


def run() -> dict[str, Any]:
    return {"start": start_up()} | {f"{hz}_hz": at(hz, rounds) for hz, rounds in RATES}


def start_up() -> dict[str, float]:
    """Seconds from the start of the process to its line `armd: ready`: from an empty cache with the
    library of the installation, and once more; without it from an empty cache, and once more. The
    floor is Python that loads what a daemon needs and opens Zenoh, the second time."""
    seconds = {}
    for _ in range(2):
        start = time.monotonic()
        subprocess.run([sys.executable, "-c", BARE_START], check=True)
        seconds["bare_s"] = time.monotonic() - start
    with (
        tempfile.TemporaryDirectory() as folder,
        simulated_arm(Path(folder)) as arm,
    ):
        calibrate(arm.folder)
        # In a virtual environment it is there since `make install`; else the cache gets it.
        cache = {"NUMBA_CACHE_DIR": f"{folder}/cache"}
        make_library = [sys.executable, "-I", "-m", "armd.compiled.ahead"]
        subprocess.run(make_library, env=os.environ | cache, check=True)
        without = {"NUMBA_CACHE_DIR": f"{folder}/other", "ARMD_WITHOUT_LIBRARY": "1"}
        for state, chosen in (
            ("cold_s", cache),
            ("warm_s", cache),
            ("without_library_cold_s", without),
            ("without_library_warm_s", without),
        ):
            start = time.monotonic()
            with running_daemon(
                arm.folder, arm.port, top=CALIBRATION, environment=chosen
            ) as daemon:
                seconds[state] = time.monotonic() - start
                daemon.stop()
    return seconds


class Second(NamedTuple):
    """A second of one series, or what was left of it."""

    latency_us: F64
    lost: int
    stolen_s: float


def at(rate_hz: int, rounds: int) -> dict[str, Any]:
    """The daemon and its floors at one rate, in turn."""
    series: defaultdict[str, list[Second]] = defaultdict(list)
    through: dict[str, float] = defaultdict(float)
    seconds, floor_seconds = SECONDS / rounds, FLOOR_SECONDS / rounds
    taken = 0
    with Stolen() as stolen:
        start_ns = time.monotonic_ns()

        def keep(name: str, latencies: Latencies, missing: I64 | None = None) -> None:
            series[name] += _seconds(latencies, missing, rate_hz, stolen)

        while taken < rounds or (
            taken < rounds * MOST_ROUNDS
            and _samples(undisturbed(series["latency"])) < ENOUGH_S * rate_hz
        ):
            bare = zenoh_alone(rate_hz, floor_seconds)
            keep("zenoh_alone", bare)
            through["bare_cpu_s"] += bare.cpu_s
            through["bare_rss_mb"] += bare.rss_mb
            keep("line_alone", line_alone(rate_hz, floor_seconds))
            latencies, missing, figures = daemon(rate_hz, seconds)
            keep("latency", latencies, missing)
            for name, value in figures.items():
                through[name] += value
            with processors_awake():
                keep("zenoh_alone_awake", zenoh_alone(rate_hz, floor_seconds))
            taken += 1
        now_ns = time.monotonic_ns()
        stolen_percent = 1e11 * stolen.between(start_ns, now_ns) / (now_ns - start_ns)
    return _compared(series, rate_hz) | {
        "points": int(through["points"]),
        "lost_before_armd": int(through["lost_before_armd"]),  # so its points say
        "cpu_percent_of_a_core": 100 * through["cpu_s"] / (taken * seconds),
        "zenoh_alone_cpu_percent_of_a_core": 100
        * through["bare_cpu_s"]
        / (taken * (floor_seconds + 1)),
        "cpu_ms_per_1000_samples": 1e6 * through["cpu_s"] / through["points"],
        "rss_mb": through["rss_mb"] / taken,
        "zenoh_alone_rss_mb": through["bare_rss_mb"] / taken,
        "goes_first": through["goes_first"] == taken,  # whether the system grants it to the
        "keeps_awake": os.access(DEVICE, os.W_OK),  # daemon, and this,
        "arm_on_time": through["arm_on_time"] == taken,  # and `on_hardware_of_its_own` to us
        "rounds": taken,
        "stolen_percent": stolen_percent,
        "undisturbed": _compared({name: undisturbed(s) for name, s in series.items()}, rate_hz),
    }


def undisturbed(series: list[Second]) -> list[Second]:
    return [second for second in series if second.stolen_s <= UNDISTURBED_S]


def daemon(
    rate_hz: int, seconds: float, through: Sequence[str] = ()
) -> tuple[Latencies, I64, dict[str, float]]:
    """Latencies from the true latch; samples missing before each point; CPU seconds of `armd run`,
    started by the program *through* if given, meanwhile."""
    with (
        tempfile.TemporaryDirectory() as folder,
        simulated_arm(Path(folder), rate_hz=rate_hz, seconds=seconds + 60) as arm,
    ):
        on_time = on_hardware_of_its_own(arm)
        calibrate(arm.folder)
        with (
            running_daemon(arm.folder, arm.port, top=CALIBRATION, through=through) as armd,
            armd.session() as session,
        ):
            arrivals = Arrivals()
            session.declare_subscriber(f"armd/{armd.serial}/point", arrivals.take)
            time.sleep(SETTLE_S)
            first, cpu_s = len(arrivals.payloads), processor_s(armd.process.pid)
            goes_first = os.sched_getscheduler(armd.process.pid) != os.SCHED_OTHER
            time.sleep(seconds)
            last, cpu_s = len(arrivals.payloads), processor_s(armd.process.pid) - cpu_s
            points, arrived_ns = arrivals.points(first, last)
            latency_us = (arrived_ns - arm.latch_ns(points["seq"])) / 1000
            rss_mb = resident_mb(armd.process.pid)
            armd.stop()
    if not len(points):
        raise RuntimeError(f"no point within {seconds:g} s: the machine is too busy to measure")
    missing = np.diff(points["seq"].astype(np.int64), prepend=int(points["seq"][0]) - 1) - 1
    flagged = (points["flags"] & Flag.SAMPLES_LOST) != 0
    figures = {
        "points": len(points),
        "lost_before_armd": int(missing[flagged].sum()),
        "cpu_s": cpu_s,
        "rss_mb": rss_mb,
        "goes_first": goes_first,
        "arm_on_time": on_time,
    }
    return Latencies(latency_us, arrived_ns), missing, figures


def on_hardware_of_its_own(arm: SimulatedArm) -> bool:
    """As far as one machine can: the arm stays on one processor and latches on time, and what it
    measures next is computed only while nobody else computes. A real arm takes no processor from
    the controller. Returns whether the system grants all of it."""
    processors = os.sched_getaffinity(0)
    if len(processors) < 2:
        return False
    pid, one = arm.process.pid, {min(processors)}
    os.sched_setaffinity(pid, one)
    for physics in Path(f"/proc/{pid}/task/{pid}/children").read_text().split():
        os.sched_setaffinity(int(physics), one)
        os.sched_setscheduler(int(physics), os.SCHED_IDLE, os.sched_param(0))
    with suppress(PermissionError):
        os.sched_setscheduler(pid, os.SCHED_FIFO, os.sched_param(LATCH_PRIORITY))
        return True
    return False


@contextmanager
def processors_awake() -> Iterator[None]:
    """As the daemon keeps them, where the system lets us."""
    awake = Awake()
    awake.keep(True)
    try:
        yield
    finally:
        awake.keep(False)


def calibrate(folder: Path) -> None:
    """A calibration.json of known expansion beside the folder's arm.toml."""
    arm = load_arm(folder / "arm.toml")
    save_calibration(folder / "calibration.json", known_expansion(arm, 2e-6))


def _seconds(
    latencies: Latencies, missing: I64 | None, rate_hz: int, stolen: Stolen
) -> Iterator[Second]:
    """A series in seconds, each with what was lost and what the host took from the arrival before
    it to its last."""
    arrived_ns = latencies.arrived_ns
    for k in range(0, len(arrived_ns), rate_hz):
        own = slice(k, k + rate_hz)
        stolen_s = stolen.between(arrived_ns[max(k - 1, 0)], arrived_ns[own][-1])
        lost = 0 if missing is None else int(missing[own].sum())
        yield Second(latencies.latency_us[own], lost, stolen_s)


def _samples(parts: list[Second]) -> int:
    return sum(len(second.latency_us) for second in parts)


def _compared(series: dict[str, list[Second]], rate_hz: int) -> dict[str, Any]:
    """Percentiles of each series, and the daemon's in those of the floors; nothing where there is
    nothing to compare."""
    seconds = {name: _samples(parts) / rate_hz for name, parts in series.items()}
    if not all(seconds.values()):
        return {"seconds": seconds}
    percentiles = {name: _percentiles(parts) for name, parts in series.items()}
    result: dict[str, Any] = percentiles | {
        "seconds": seconds,
        "lost": sum(second.lost for second in series["latency"]),
    }
    for key, latency_us in percentiles["latency"].items():
        name, alone_us = key.removesuffix("_us"), percentiles["zenoh_alone"][key]
        result[f"{name}_ratio"] = latency_us / alone_us
        result[f"{name}_ratio_to_floors"] = latency_us / (alone_us + percentiles["line_alone"][key])
        result[f"{name}_ratio_awake"] = latency_us / percentiles["zenoh_alone_awake"][key]
    return result


def _percentiles(parts: list[Second]) -> dict[str, float]:
    latency_us = np.concatenate([second.latency_us for second in parts])
    p50, p99, p99_9 = np.percentile(latency_us, [50, 99, 99.9])
    return {"p50_us": float(p50), "p99_us": float(p99), "p99_9_us": float(p99_9)}

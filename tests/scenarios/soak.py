"""`make soak MINUTES=…`: simulator, daemon, recorder, subscribers under random faults.

Prints a report as JSON; exit code 1 if a point was wrong, a loss unexplained, the recording not of
every point delivered, or a process did not end well.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import math
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader

import armd
from armd.arrays import F64
from armd.stream import Stream
from support.audit import Audit
from support.program import ARMD
from support.running_daemon import running_daemon
from support.simulated_arm import SimulatedArm, simulated_arm
from support.true_model import write_true_model

RATE_HZ = 1000
FAULTS_PER_MINUTE = 12
STOP_AND_START_S = 7.0  # how long the second subscriber stands still, then runs
WARM_S = 20.0  # memory counts from here
BLOCKS = 10  # of the run, for the slope of memory
#: Standard uncertainties to either side in which the slope lies in 95 of 100 runs: Student's, by 8
#: degrees of freedom.
COVERAGE = 2.306


class Memory:
    """Resident memory of a process, looked at once a second."""

    def __init__(self, pid: int) -> None:
        self._status = Path(f"/proc/{pid}/status")
        self._start_s = time.monotonic()
        self._seen: list[tuple[float, float]] = []

    def look(self) -> None:
        line = next(x for x in self._status.read_text().splitlines() if x.startswith("VmRSS"))
        if (age_s := time.monotonic() - self._start_s) > WARM_S:
            self._seen.append((age_s, int(line.split()[1]) / 1024))

    def report(self) -> dict[str, float | None]:
        """Where it ended, what it grew by, and the slope of a line over the run: its uncertainty,
        and the interval in which it lies in 95 of 100 runs."""
        slope, uncertainty = slope_per_hour(*np.array(self._seen, float).reshape(-1, 2).T)
        resident = [mb for _, mb in self._seen] or [math.nan]
        figures = {
            "memory_mb": resident[-1],
            "memory_growth_mb": resident[-1] - resident[0],
            "memory_slope_mb_per_hour": slope,
            "memory_slope_standard_uncertainty_mb_per_hour": uncertainty,
            "memory_slope_at_least_mb_per_hour": slope - COVERAGE * uncertainty,
            "memory_slope_at_most_mb_per_hour": slope + COVERAGE * uncertainty,
        }
        return {name: round(x, 2) if math.isfinite(x) else None for name, x in figures.items()}


def slope_per_hour(time_s: F64, mb: F64) -> tuple[float, float]:
    """Of a straight line through MB over seconds (N,), in MB an hour, and its standard uncertainty;
    NaN for too few to say.

    Memory grows in steps that last: what is left beside the line is no noise from second to second.
    So the line goes through the means of BLOCKS equal stretches, and their scatter about it counts.
    """
    if len(mb) < 2 * BLOCKS:
        return math.nan, math.nan
    hours, level = (
        np.array([part.mean() for part in np.array_split(values, BLOCKS)])
        for values in (time_s / 3600, mb)
    )
    from_middle = hours - hours.mean()
    slope = float(from_middle @ level / (from_middle @ from_middle))
    left = level - level.mean() - slope * from_middle
    variance = float(left @ left) / (BLOCKS - 2) / float(from_middle @ from_middle)
    return slope, math.sqrt(variance)


@contextlib.contextmanager
def recorder(endpoint: str, file: Path) -> Iterator[subprocess.Popen[str]]:
    """`armd record`, once it records."""
    command = [*ARMD, "record", "SIM-0001", "--endpoint", endpoint, "-o", str(file)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("armd: recording")
            yield process
        finally:
            process.terminate()


def recorded_points(file: Path) -> int:
    """Points in a recording."""
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None and summary.statistics is not None
    channel = next(c.id for c in summary.channels.values() if c.topic == "/point")
    return summary.statistics.channel_message_counts.get(channel, 0)


@contextlib.contextmanager
def stopping_subscriber(endpoint: str) -> Iterator[subprocess.Popen[bytes]]:
    """`armd watch --json`, to be stopped and started by signals."""
    command = [*ARMD, "watch", "SIM-0001", "--json", "--endpoint", endpoint]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.kill()


def soak(minutes: float, seed: int, folder: Path) -> dict[str, Any]:
    """Run it; figures by name."""
    write_true_model(folder, seed)
    (folder / "scenario.toml").write_text(f"faults_per_minute = {FAULTS_PER_MINUTE}\n")
    options = ("--scenario", str(folder / "scenario.toml"), "--seed", str(seed))
    # The daemon first: it waits for its arm, and misses no boot of it.
    with (
        running_daemon(folder, str(folder / "port"), top='calibration = "calibration.json"') as d,
        armd.connect("SIM-0001", d.endpoint) as client,
        client.stream(armd.keys.POINT) as points,  # before the arm, or its first points are missed
        recorder(d.endpoint, folder / "soak.mcap") as record,
        stopping_subscriber(d.endpoint) as second,
        simulated_arm(
            folder, *options, rate_hz=RATE_HZ, seconds=60 * minutes, link=True, arm_toml=False
        ) as arm,
    ):
        audit = Audit(folder / "truth.bin", RATE_HZ)
        memory = Memory(d.process.pid)
        _follow(arm, client, points, audit, memory, second)
        record.terminate()
        recorder_code = record.wait(30)
        code, stop_s = d.stop()
    log = arm.events()
    report = audit.report(log)
    faults = [line["fault"] for line in log if line["event"] == "begin"]
    return {
        "minutes": minutes,
        "seed": seed,
        "faults": {name: faults.count(name) for name in sorted(set(faults))},
        "latched": len(arm.truth()),
        "sent": len(arm.truth()) - len(arm.withheld()),
        **report,
        "recorded": recorded_points(folder / "soak.mcap"),
        "recorder_exit_code": recorder_code,
        **memory.report(),
        "daemon_exit_code": code,
        "daemon_stop_s": round(stop_s, 2),
    }


def _follow(
    arm: SimulatedArm,
    client: armd.Arm,
    points: Stream,
    audit: Audit,
    memory: Memory,
    second: subprocess.Popen[bytes],
) -> None:
    """Until the simulated arm ends; the second subscriber stands still now and then."""
    stopped = False
    next_s = next_look_s = time.monotonic()
    ended_s: float | None = None
    while ended_s is None or time.monotonic() < ended_s + 1.0:
        if payloads := points.take():
            audit.take(client.decode(payloads), time.monotonic_ns())
        now_s = time.monotonic()
        if now_s >= next_s:
            next_s = now_s + STOP_AND_START_S
            second.send_signal(signal.SIGCONT if stopped else signal.SIGSTOP)
            stopped = not stopped
        if now_s >= next_look_s:
            next_look_s = now_s + 1.0
            memory.look()
            audit.settle()
        if ended_s is None and arm.process.poll() is not None:
            ended_s = now_s
        time.sleep(0.002)
    audit.settle()


def what_is_bad(report: dict[str, Any]) -> list[str]:
    """A sentence for each figure that must be otherwise; none for a good run."""
    zero = ("wrong", "unexplained", "recorder_exit_code", "daemon_exit_code")
    bad = [f"{name} is {report[name]}, expected 0" for name in zero if report[name]]
    if not report["delivered"]:
        bad.append("no point was delivered")
    if report["recorded"] != report["delivered"]:
        bad.append(f"{report['recorded']} points recorded, {report['delivered']} delivered")
    return bad


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=2.0)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="armd-soak-") as folder:
        report = soak(options.minutes, options.seed, Path(folder))
    print(json.dumps(report, indent=2))
    bad = what_is_bad(report)
    for sentence in bad:
        print(f"soak: {sentence}", file=sys.stderr)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())

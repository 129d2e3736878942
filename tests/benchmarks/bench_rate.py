"""The highest sample rate at which every point reaches a subscriber in another process.

The simulator ends at 5 kHz; here packets packed beforehand are sent at multiples of that, with the
daemon, its subscriber and the sender on the same machine. A rate counts as held when the line took
every packet and every number arrived, in one of three tries: a host that takes the processors away
for longer than the port holds makes every rate lose.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections import defaultdict
from itertools import pairwise, takewhile
from pathlib import Path
from typing import Any

import numpy as np
from bench_daemon import CALIBRATION, calibrate
from measured import processor_s

from support.running_daemon import running_daemon
from support.simulated_arm import simulated_arm

RATES_HZ = (5_000, 10_000, 15_000, 20_000, 30_000, 40_000)
TRIES = 3
SECONDS = 5.0


def run() -> dict[str, Any]:
    """By rate and try: points sent, found no room, lost of all; and what of a processor the daemon
    took in the last try. `highest_hz`: the last rate held in ascending order."""
    tries = [rate_hz for rate_hz in RATES_HZ for _ in range(TRIES)]
    pump = [sys.executable, str(Path(__file__).with_name("pump.py"))]
    command = [*pump, *map(str, tries), str(SECONDS)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with simulated_arm(folder, seconds=0.1) as arm:  # for its arm.toml
            arm.wait()
        calibrate(folder)
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as sender:
            assert sender.stdin is not None and sender.stdout is not None
            port = sender.stdout.readline().strip()
            with running_daemon(folder, port, top=CALIBRATION) as armd, armd.listen() as heard:
                sender.stdin.write("go\n")
                sender.stdin.flush()
                sent, cpu_s = [], [0.0]
                for line in sender.stdout:
                    sent.append(tuple(map(int, line.split())))
                    cpu_s.append(processor_s(armd.process.pid))
                seqs = heard.points()["seq"]
                armd.stop()
    figures: defaultdict[int, dict[str, list[int]]] = defaultdict(lambda: defaultdict(list))
    took_s = {
        rate_hz: after - before
        for (rate_hz, *_), (before, after) in zip(sent, pairwise(cpu_s), strict=True)
    }  # of several tries the last
    for rate_hz, first, last, unsent in sent:
        arrived = int(np.count_nonzero((seqs >= first) & (seqs <= last)))
        figures[rate_hz]["sent"].append(last - first + 1)
        figures[rate_hz]["no_room"].append(unsent)
        figures[rate_hz]["lost"].append(last - first + 1 - arrived)
    held = takewhile(lambda rate_hz: min(figures[rate_hz]["lost"]) == 0, RATES_HZ)
    return {"highest_hz": max(held, default=0)} | {
        f"{rate_hz}_hz": {**tried, "processor_percent": 100 * took_s[rate_hz] / SECONDS}
        for rate_hz, tried in figures.items()
    }

"""The highest sample rate at which every point reaches a subscriber in another process.

The simulator ends at 5 kHz; here packets packed beforehand are sent at multiples of that, with the
daemon, its subscriber and the sender on the same machine. A rate counts as held when the line took
every packet and every number arrived.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from bench_daemon import CALIBRATION, calibrate
from running_daemon import running_daemon
from simulated_arm import simulated_arm

RATES_HZ = (5_000, 10_000, 15_000, 20_000, 30_000, 40_000)
SECONDS = 5.0


def run() -> dict[str, Any]:
    """By rate: points lost of those sent; `highest_hz`: the last rate held in ascending order."""
    pump = [sys.executable, str(Path(__file__).with_name("pump.py"))]
    command = [*pump, *map(str, RATES_HZ), str(SECONDS)]
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
                sent = [tuple(map(int, line.split())) for line in sender.stdout]
                seqs = heard.points()["seq"]
                armd.stop()
    figures: dict[str, Any] = {"highest_hz": 0}
    held = True
    for rate_hz, first, last, unsent in sent:
        arrived = int(np.count_nonzero((seqs >= first) & (seqs <= last)))
        lost = last - first + 1 - arrived
        figures[f"{rate_hz}_hz"] = {"sent": last - first + 1, "no_room": unsent, "lost": lost}
        held = held and lost == 0
        if held:
            figures["highest_hz"] = rate_hz
    return figures

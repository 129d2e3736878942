"""A simulated arm in a process of its own, for tests over the wire.

    with simulated_arm(tmp_path, "--fault", "silence@2:0.5", seconds=4) as arm:
        ...                                # open arm.port
        arm.wait()                         # until its seconds are over
    arm.truth(), arm.events("withheld")

The fault log names every latch that did not get out; all others of the truth file did, from the
moment on when somebody read.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

TRUTH = np.dtype([("seq", "<u8"), ("position_mm", "<f8", (3,))])


@dataclass
class SimulatedArm:
    process: subprocess.Popen[str]
    port: str  # the path printed; with a link, the link
    arm_toml: Path
    folder: Path

    def wait(self, timeout_s: float = 60.0) -> int:
        """Until the simulator's seconds are over; its exit code."""
        return self.process.wait(timeout_s)

    def stop(self) -> int:
        """End it as systemd would; its exit code."""
        self.process.terminate()
        return self.process.wait(60.0)

    def truth(self) -> np.ndarray:
        """Records of `TRUTH`: the true tip of each latch, by seq as published."""
        data = (self.folder / "truth.bin").read_bytes()
        return np.frombuffer(data[: len(data) // TRUTH.itemsize * TRUTH.itemsize], TRUTH)

    def events(self, event: str | None = None) -> list[dict[str, Any]]:
        """The fault log's lines so far, of one kind or all."""
        text = (self.folder / "faults.jsonl").read_text(encoding="utf-8")
        lines = [json.loads(line) for line in text.splitlines(keepends=True) if line[-1] == "\n"]
        return [line for line in lines if event in (None, line["event"])]

    def withheld(self, reason: str | None = None) -> set[int]:
        """Every seq that never left whole, for this reason or for any."""
        runs = [run for run in self.events("withheld") if reason in (None, run["reason"])]
        return {seq for run in runs for seq in range(run["first_seq"], run["last_seq"] + 1)}

    def latch_ns(self, seq: np.ndarray) -> np.ndarray:
        """The true instants (CLOCK_MONOTONIC) of latches of the first boot."""
        boot = self.events("boot")[0]
        period_ns = 1e9 / (boot["rate_hz"] * (1 + boot["clock_ppm"] * 1e-6))
        return boot["latch_monotonic_ns"] + (seq - boot["seq"]) * period_ns


@contextmanager
def simulated_arm(
    folder: Path,
    *options: str,
    wire: tuple[str, ...] = ("--serial",),
    rate_hz: int = 1000,
    seconds: float = 300.0,
    link: bool = False,
    arm_toml: bool = True,
) -> Iterator[SimulatedArm]:
    """Start `python -m armd.simulator`; its files go to *folder*; it ends with the block."""
    command = [sys.executable, "-m", "armd.simulator", *wire, "--rate", str(rate_hz)]
    command += ["--truth", str(folder / "truth.bin"), "--fault-log", str(folder / "faults.jsonl")]
    if arm_toml:
        command += ["--arm-out", str(folder / "arm.toml")]
    command += ["--seconds", str(seconds)]  # so that none outlives a test that is killed
    if link:
        command += ["--link", str(folder / "port")]
    with subprocess.Popen([*command, *options], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            printed = process.stdout.readline().strip()
            if not printed:
                pytest.fail(f"the simulator ended with {process.wait(60)} before it began")
            port = str(folder / "port") if link else printed
            yield SimulatedArm(process, port, folder / "arm.toml", folder)
        finally:
            process.terminate()

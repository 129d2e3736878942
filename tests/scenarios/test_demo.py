"""`armd demo` as a newcomer runs it, with the README's subscriber in ten lines beside it."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from support.long_case import long_case
from support.punctuality import Machine, Punctuality

SUBSCRIBER = Path(__file__).parents[2] / "docs/examples/subscriber.py"


class Ran(NamedTuple):
    code: int
    printed: str
    heard: list[str]  # the subscriber's lines
    machine: Machine


pytestmark = pytest.mark.serial  # it counts losses
COMMAND = [sys.executable, "-m", "armd.daemon.cli", "demo", "--seconds", "10"]


@pytest.fixture(scope="module")
def demo(punctuality: Punctuality) -> Ran:
    with punctuality.watch() as machine:
        return run_demo(machine)


def run_demo(machine: Machine) -> Ran:
    process = subprocess.Popen(
        COMMAND, stdout=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )  # fmt: skip
    try:
        assert process.stdout is not None
        endpoint = None
        while endpoint is None and (line := process.stdout.readline()):
            endpoint = re.match(r"endpoint  (tcp/\S+)", line)
        assert endpoint is not None
        heard = subprocess.run(
            [sys.executable, str(SUBSCRIBER), endpoint[1]],
            capture_output=True, text=True, timeout=60, check=True,
        ).stdout.splitlines()  # fmt: skip
    finally:
        printed = process.communicate()[0]
    return Ran(process.returncode, printed, heard, machine)


def figures_of(printed: str) -> dict[str, str]:
    return dict(re.findall(r"^(\w[\w ]+?) {2,}([\d.]+)", printed, re.MULTILINE))


def test_it_loses_nothing_and_improves_fivefold(demo: Ran) -> None:
    figures = figures_of(demo.printed)
    assert demo.code == (figures["lost"] != "0"), demo.printed
    assert int(figures["samples"]) > 1000
    demo.machine.judge_lost(int(figures["lost"]), "the demo")
    assert 0 < float(figures["latency p50"]) <= float(figures["latency p99"])
    assert float(figures["improvement"]) >= 5.0
    assert float(figures["error before"]) > 40.0  # the arm did warm up


def test_the_panel_says_what_a_person_asks_first(demo: Ran) -> None:
    for words in ("uncertainty", "µm (k = 2)", "t1 ", "calibration ", "live", "Ctrl-C ends it"):
        assert words in demo.printed


def test_the_subscriber_in_ten_lines_hears_it(demo: Ran) -> None:
    points = [line for line in demo.heard if re.match(r"\d+  +-?\d+\.\d{3}", line)]
    seq = np.array([int(line.split()[0]) for line in points])
    assert len(points) > 100 and demo.heard[-1] == f"lost: {(np.diff(seq) - 1).sum()}"
    demo.machine.judge_gaps(seq, "the demo's subscriber")


@pytest.mark.slow
@pytest.mark.crowd
@pytest.mark.parametrize(
    ("wire", "joints"),
    [
        ("", 3),
        long_case("", 7),
        ("--can", 9),
        long_case("--servo=feetech", 5),
        ("--servo=dynamixel", 9),
    ],
)
def test_arms_of_few_and_of_many_joints(wire: str, joints: int, punctuality: Punctuality) -> None:
    options = [*([wire] if wire else []), "--joints", str(joints)]
    with punctuality.watch() as machine:
        done = subprocess.run([*COMMAND, *options], capture_output=True, text=True, timeout=200)
    figures = figures_of(done.stdout)
    assert int(figures["samples"]) > 1000, done.stdout + done.stderr
    assert done.returncode == (figures["lost"] != "0")
    if not wire.startswith("--servo"):
        machine.judge_lost(int(figures["lost"]), "the demo")
    # Off its drawing by tenths of a millimetre and of a degree, and by play on servos.
    assert 5.0 < float(figures["error"]) < 5000.0

"""`armd demo` as a newcomer runs it: a sound stream, and points five times better."""

from __future__ import annotations

import re
import subprocess
import sys


def test_the_demo_loses_nothing_and_improves_fivefold():
    done = subprocess.run(
        [sys.executable, "-m", "armd.daemon.cli", "demo", "--seconds", "12"],
        capture_output=True,
        text=True,
        timeout=200,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    figures = dict(re.findall(r"^(\w[\w ]+?) {2,}([\d.]+)", done.stdout, re.MULTILINE))
    assert int(figures["samples"]) > 10_000
    assert figures["lost"] == "0"
    assert 0 < float(figures["latency p50"]) <= float(figures["latency p99"])
    assert float(figures["improvement"]) >= 5.0
    assert float(figures["error before"]) > 40.0  # the arm did warm up

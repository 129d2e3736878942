"""`armd` in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

ARMD = [sys.executable, "-m", "armd.daemon.cli"]


def run_armd(*words: object, **options: Any) -> subprocess.CompletedProcess[str]:
    """Until it ends, with what it said; *options* are `subprocess.run`'s."""
    command = [*ARMD, *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=200, **options)


def start_recording(endpoint: str, *words: object) -> subprocess.Popen[str]:
    """`armd record`, once it says that it records."""
    command = [*ARMD, "record", "--endpoint", endpoint, *map(str, words)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert "recording" in process.stdout.readline()
    return process

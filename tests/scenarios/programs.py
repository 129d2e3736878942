"""A program run beside a scenario: up when it says so, ended with it."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def program(command: Sequence[str], log: Path, ready: str = "") -> Iterator[subprocess.Popen[str]]:
    """Running from the line that begins with *ready* on; *log* has what it says on standard error,
    and is what `SystemExit` shows where that line does not come."""
    with (
        log.open("a") as errors,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True) as running,
    ):
        try:
            assert running.stdout is not None
            line = running.stdout.readline().strip()
            if not line or not line.startswith(ready):
                raise SystemExit(log.read_text())
            yield running
        finally:
            running.terminate()
            running.wait(60)

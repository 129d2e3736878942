"""Ctrl-C while a command starts: it ends without a traceback."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest


@pytest.mark.parametrize("after_s", [0.8, 1.5])
@pytest.mark.parametrize("words", [["demo"], ["simulate", "--serial"]])
def test_an_interrupt_at_the_start_leaves_no_traceback(words: list[str], after_s: float) -> None:
    command = [sys.executable, "-m", "armd.daemon.cli", *words]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        time.sleep(after_s)
        process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=60)
    assert "Traceback" not in told, told
    assert process.returncode in (0, 130, -signal.SIGINT)

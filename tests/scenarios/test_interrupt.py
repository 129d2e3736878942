"""Ctrl-C while a command starts: it ends without a traceback."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

from support.program import ARMD
from support.selection import parametrize_default


@parametrize_default("after_s", [0.8, 1.5])
@parametrize_default("words", [["demo"], ["simulate", "--serial"]])
def test_an_interrupt_at_the_start_leaves_no_traceback(words: list[str], after_s: float) -> None:
    command, pipe = [*ARMD, *words], subprocess.PIPE
    with subprocess.Popen(
        command, stdout=pipe, stderr=pipe, text=True, start_new_session=True
    ) as process:
        time.sleep(after_s)
        process.send_signal(signal.SIGINT)
        _, told = process.communicate(timeout=60)
    assert "Traceback" not in told, told
    assert process.returncode in (0, 130, -signal.SIGINT)


@pytest.mark.parametrize(
    ("handler", "code"), [("default_int_handler", -signal.SIGINT), ("SIG_IGN", 9)]
)
def test_an_interrupt_as_the_simulator_takes_over_is_not_lost(handler: str, code: int) -> None:
    """One that Python has noted and not raised yet ends with the program that gives way: of 72
    signals in the last 60 µs before, 46 were lost. One that is ignored stays so (`nohup`)."""
    program = f"""
import os, signal, sys
from armd.daemon.commands.service.simulate import replace_process
signal.signal(signal.SIGINT, signal.{handler})

def execv(*_):
    try:
        signal.raise_signal(signal.SIGINT)
    except KeyboardInterrupt:
        sys.exit(7)
    sys.exit(9)

os.execv = execv
replace_process([])
"""
    done = subprocess.run([sys.executable, "-c", program], timeout=60, check=False)
    assert done.returncode == code

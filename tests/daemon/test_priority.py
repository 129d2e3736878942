"""The stream's thread goes first where it may, and alone."""

from __future__ import annotations

import os
import subprocess
import sys
import threading

import pytest

from armd.daemon.priority import go_first

FIRST_AND_LATER = """
import os, threading
from armd.daemon.priority import go_first
go_first()
later = threading.Thread(target=lambda: print(os.sched_getscheduler(0)))
later.start(); later.join()
print(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK)
"""


def may_go_first() -> bool:
    if len(os.sched_getaffinity(0)) < 2:
        return False
    allowed = []

    def try_it() -> None:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
            allowed.append(True)
        except OSError:
            pass

    thread = threading.Thread(target=try_it)
    thread.start()
    thread.join()
    return bool(allowed)


@pytest.mark.skipif(not may_go_first(), reason="this machine grants no real-time priority")
def test_the_calling_thread_alone() -> None:
    done = subprocess.run([sys.executable, "-c", FIRST_AND_LATER], capture_output=True, text=True)
    later, first = map(int, done.stdout.split())
    assert (later, first) == (os.SCHED_OTHER, os.SCHED_FIFO), done.stderr


def test_without_the_right_nothing_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    go_first()
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


@pytest.mark.skipif(not may_go_first(), reason="this machine grants no real-time priority")
def test_a_machine_with_one_processor_is_shared() -> None:
    alone = "import os\nos.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n"
    program = [sys.executable, "-c", alone + FIRST_AND_LATER]
    done = subprocess.run(program, capture_output=True, text=True)
    assert [int(word) for word in done.stdout.split()] == [os.SCHED_OTHER] * 2, done.stderr

"""The stream's thread goes first where it may, Zenoh's sending thread with it, and no other."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import pytest

from armd.daemon.host.priority import PRIORITY, SENDER_NAME, raise_priority, raise_sender_priority
from support.running_daemon import running_daemon
from support.simulated_arm import simulated_arm

FIRST_AND_LATER = """
import os, threading
from armd.daemon.host.priority import raise_priority
raise_priority()
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
    raise_priority()
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


@pytest.mark.skipif(not may_go_first(), reason="this machine grants no real-time priority")
def test_a_machine_with_one_processor_is_shared() -> None:
    alone = "import os\nos.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n"
    program = [sys.executable, "-c", alone + FIRST_AND_LATER]
    done = subprocess.run(program, capture_output=True, text=True)
    assert [int(word) for word in done.stdout.split()] == [os.SCHED_OTHER] * 2, done.stderr


@pytest.mark.slow
def test_zenohs_sending_thread_goes_first_where_the_stream_does(tmp_path: Path) -> None:
    """And no other thread of the daemon's; found once a subscriber is there."""
    if not may_go_first():
        pytest.skip("this machine grants no real-time priority")
    with (
        simulated_arm(tmp_path) as arm,
        running_daemon(arm.folder, arm.port) as daemon,
        daemon.listen() as heard,
    ):
        heard.wait_for(lambda: priorities(daemon.process.pid).get(SENDER_NAME))
        first = {name: p for name, p in priorities(daemon.process.pid).items() if p}
    assert first.pop(SENDER_NAME) == PRIORITY
    assert list(first.values()) == [PRIORITY], first  # the main thread


def priorities(pid: int) -> dict[str, int]:
    """The highest real-time priority among the threads of each name; 0 is an ordinary one."""
    found: dict[str, int] = {}
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(OSError):  # it may just have ended
            name = (task / "comm").read_text().strip()
            priority = os.sched_getparam(int(task.name)).sched_priority
            found[name] = max(priority, found.get(name, 0))
    return found


def test_nothing_is_asked_again_where_the_stream_is_ordinary() -> None:
    assert os.sched_getscheduler(0) == os.SCHED_OTHER
    assert raise_sender_priority()

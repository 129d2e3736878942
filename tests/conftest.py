"""For all tests: the user's home is left alone; what has deadlines runs one at a time.

With ``pytest -n 3`` (``make test``) one worker runs all that reads wires, in its order, as it would
alone; one what talks over Zenoh and waits for others most of its time, a little behind it; one
computes, at the lowest priority, so that a live test finds the processor as free as it was. What is
marked `crowd` needs all processors there are, and runs after the others, alone: a crowd of arms, or
one that a busy machine of two slow processors can no longer follow.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import pytest

ONLY_COMPUTES = (
    *(
        f"tests/{room}/"
        for room in (
            "compensation", "diagnose", "effects", "estimate", "hidden", "identify", "interim",
            "model", "outsider", "real", "package",
        )
    ),
    "tests/simulator/test_hidden_cases.py",
    "tests/simulator/test_sessions.py",
)  # fmt: skip
"""Tests that wait for nobody: no daemon, no wire, no clock."""

WAITS = tuple(f"tests/{room}/" for room in ("bridges", "daemon", "deploy"))
"""Folders of tests whose daemons and servers idle between messages, with deadlines of seconds."""
WAITS_NICE = 10


@pytest.hookimpl(optionalhook=True)  # nothing to hand out where pytest-xdist is not installed
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    from xdist.scheduler import LoadScopeScheduling

    class OneForEachThatIsLive(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            if nodeid.startswith(ONLY_COMPUTES):
                return nodeid
            return "waits" if nodeid.startswith(WAITS) else "live"

    return OneForEachThatIsLive(config, log)


def pytest_runtest_setup(item: pytest.Item) -> None:
    if "PYTEST_XDIST_WORKER" in os.environ:
        if item.nodeid.startswith(ONLY_COMPUTES):
            os.nice(19 - os.nice(0))
        elif item.nodeid.startswith(WAITS):
            os.nice(max(0, WAITS_NICE - os.nice(0)))


@pytest.fixture(autouse=True, scope="session")
def interrupts_arrive() -> None:
    """Where a shell starts the tests in the background, SIGINT is ignored, and so it is in every
    process that a test starts and interrupts."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(autouse=True, scope="session")
def own_state_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        os.environ.pop("STATE_DIRECTORY", None)
        yield

"""For all tests: the user's home is left alone; what runs live runs one at a time.

With ``pytest -n 2`` (``make test``) one worker runs all that talks over wires and Zenoh, in its
order, as it would alone; the other computes, at the lowest priority, so that a live test finds the
processor as free as it was.
"""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

ONLY_COMPUTES = tuple(
    f"tests/{room}/"
    for room in ("compensation", "diagnose", "hidden", "interim", "real", "umbrella")
)
"""Folders of tests that wait for nobody: no daemon, no wire, no clock."""


@pytest.hookimpl(optionalhook=True)  # nothing to hand out where pytest-xdist is not installed
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    from xdist.scheduler import LoadScopeScheduling

    class OneForAllThatIsLive(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return nodeid if nodeid.startswith(ONLY_COMPUTES) else "live"

    return OneForAllThatIsLive(config, log)


def pytest_runtest_setup(item: pytest.Item) -> None:
    if "PYTEST_XDIST_WORKER" in os.environ and item.nodeid.startswith(ONLY_COMPUTES):
        os.nice(19 - os.nice(0))


@pytest.fixture(autouse=True, scope="session")
def own_state_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        os.environ.pop("STATE_DIRECTORY", None)
        yield

"""For all tests: the user's home stays untouched, and no test fails because a machine is slow.

``make test`` runs a file's tests in one of three workers (pytest-xdist, ``--dist loadfile``), then
the tests marked `serial`, two files at a time and nothing beside them. A test waits until something
happens, with a generous limit, and asserts what must never happen. Only a `serial` test may measure
seconds, and `support.punctuality` judges them by what the machine gave. `support.budget` reports
tests that compute longer than 10 s, and files without a test in ``make test``.
"""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Iterator

import hypothesis
import pytest

pytest_plugins = ["support.punctuality", "support.budget"]

hypothesis.settings.register_profile(
    "any machine",
    deadline=None,
    suppress_health_check=[hypothesis.HealthCheck.too_slow],
)
hypothesis.settings.load_profile("any machine")


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


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Scenarios first: they wait longest, and a worker that begins one last is waited for."""
    items.sort(key=lambda item: item.path.parent.name != "scenarios")


gc.disable()


def pytest_collection_finish() -> None:
    """Five thousand tests are there to stay: whoever looks for garbage later passes over them."""
    gc.freeze()
    gc.enable()

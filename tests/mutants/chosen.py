"""A pytest plugin: runs some tests, in a given order, and writes down the first that fails.

Loaded with `-p mutants.chosen` by `mutants.trial`.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

#: Of the file with the tests to run, one a line; and of that in which the running one stands.
TESTS, RUNNING = "ARMD_MUTANTS_TESTS", "ARMD_MUTANTS_RUNNING"

# Processes that tests start do not look for modules here
os.environ.pop("PYTHONPATH", None)


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    chosen = Path(os.environ[TESTS]).read_text(encoding="utf-8").splitlines()
    order = {test: i for i, test in enumerate(chosen)}
    config.hook.pytest_deselected(items=[item for item in items if item.nodeid not in order])
    items[:] = sorted(
        (item for item in items if item.nodeid in order), key=lambda item: order[item.nodeid]
    )


def pytest_runtest_logstart(nodeid: str) -> None:
    Path(os.environ[RUNNING]).write_text(nodeid, encoding="utf-8")


def pytest_collectreport(report: pytest.CollectReport) -> None:
    if report.failed:
        Path(os.environ[RUNNING]).write_text(report.nodeid, encoding="utf-8")

"""A pytest plugin: reports tests that compute longer than `make test` allows.

It measures processor seconds, of the test's process and of the processes that it waited for, so a
busy machine changes nothing. The report never fails a run.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence

import pytest

from support.punctuality import take_unjudged

LIMIT_S = 10.0
PROPERTY = "processor_s"
UNJUDGED = "unjudged"
STARTED = pytest.StashKey[float]()
WITHOUT_DEFAULT = pytest.StashKey[list[str]]()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--processor-limit",
        type=float,
        default=LIMIT_S,
        metavar="SECONDS",
        help="report tests that used more processor time (default: %(default)s)",
    )


def measure_processor_s() -> float:
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: Sequence[pytest.Item]) -> None:
    """Notes files whose tests are all slow, before `-m` deselects them."""
    files = {item.location[0] for item in items}
    default = {item.location[0] for item in items if item.get_closest_marker("slow") is None}
    config.stash[WITHOUT_DEFAULT] = sorted(files - default)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    item.stash[STARTED] = measure_processor_s()
    yield


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> None:
    if call.when != "teardown":
        return
    item.user_properties += [(UNJUDGED, text) for text in take_unjudged()]
    if item.get_closest_marker("slow") is None:
        used_s = measure_processor_s() - item.stash.get(STARTED, measure_processor_s())
        item.user_properties.append((PROPERTY, used_s))


def pytest_terminal_summary(
    terminalreporter: pytest.TerminalReporter, config: pytest.Config
) -> None:
    reports = [
        report
        for group in terminalreporter.stats.values()
        for report in group
        if isinstance(report, pytest.TestReport) and report.when == "teardown"
    ]
    used = [
        (float(str(seconds)), report.nodeid)
        for report in reports
        for name, seconds in report.user_properties
        if name == PROPERTY
    ]
    limit_s = config.getoption("--processor-limit")
    over = sorted((row for row in used if row[0] > limit_s), reverse=True)
    if over:
        terminalreporter.section(f"tests that used more than {limit_s:g} s of processor time")
        for seconds, nodeid in over:
            terminalreporter.write_line(f"{seconds:6.1f} s {nodeid}")
    if used:
        total_s = sum(seconds for seconds, _ in used)
        terminalreporter.write_line(f"armd: {total_s:.0f} s of processor time in {len(used)} tests")
    unjudged = [
        f"{report.nodeid}: {text}"
        for report in reports
        for name, text in report.user_properties
        if name == UNJUDGED
    ]
    if unjudged:
        terminalreporter.section(f"{len(unjudged)} limits not judged: a busy machine")
        for line in unjudged:
            terminalreporter.write_line(line)
    without = config.stash.get(WITHOUT_DEFAULT, [])
    if without:
        terminalreporter.write_line("armd: files without a test in make test: " + " ".join(without))

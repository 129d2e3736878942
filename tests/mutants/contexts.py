"""A pytest plugin: coverage is kept by test, in the test's process and in those that it starts.

A fixture that several tests share has a context of its own; which tests use it is written down, so
that its lines count for each of them. Loaded with `-p mutants.contexts` by `mutants.covering`.
"""

from __future__ import annotations

import json
import os
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import coverage
import pytest

#: The folder for what this writes, and the context that started processes take.
FOLDER, CONTEXT = "ARMD_MUTANTS_FOLDER", "ARMD_MUTANTS_CONTEXT"

_seconds: defaultdict[str, float] = defaultdict(float)
_failed: set[str] = set()
_fixtures: dict[str, list[str]] = {}


def name_fixture(definition: pytest.FixtureDef[Any]) -> str:
    return f"fixture {definition.baseid}::{definition.argname}"


def _switch(context: str) -> None:
    os.environ[CONTEXT] = context
    current = coverage.Coverage.current()
    if current is not None:
        current.switch_context(context)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    _switch(item.nodeid)
    result = yield
    _switch("")
    return result


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_fixture_setup(
    fixturedef: pytest.FixtureDef[Any], request: pytest.FixtureRequest
) -> Iterator[None]:
    if fixturedef.scope == "function":
        return (yield)
    before = os.environ.get(CONTEXT, "")
    _switch(name_fixture(fixturedef))
    try:
        return (yield)
    finally:
        _switch(before)


def pytest_collection_finish(session: pytest.Session) -> None:
    for item in session.items:
        known = getattr(item, "_fixtureinfo", None)
        definitions = known.name2fixturedefs.values() if known is not None else ()
        shared = [one[-1] for one in definitions if one and one[-1].scope != "function"]
        _fixtures[item.nodeid] = sorted(map(name_fixture, shared))


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    _seconds[report.nodeid] += report.duration
    if report.failed:
        _failed.add(report.nodeid)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """The first worker, or the only process, knows the fixtures; whoever reports, the seconds."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    record = {"fixtures": _fixtures, "seconds": {}, "failed": []} if worker else {
        "fixtures": _fixtures, "seconds": _seconds, "failed": sorted(_failed)
    }  # fmt: skip
    path = Path(os.environ[FOLDER]) / f"tests-{os.getpid()}.json"
    path.write_text(json.dumps(record), encoding="utf-8")

"""Each benchmark that `make bench` names can be loaded: what it measures still exists."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest


def test_every_benchmark_loads(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    names = importlib.import_module("run").NAMES
    assert len(names) == len(list(Path(__file__).parent.glob("bench_*.py")))
    for name in names:
        assert callable(importlib.import_module(f"bench_{name}").run)

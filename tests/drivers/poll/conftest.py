"""Doubles of servos answer from a thread: a starved machine makes them late, not silent."""

from __future__ import annotations

import pytest

from armd.drivers.poll import answers


@pytest.fixture(autouse=True)
def patient(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """But for tests that measure seconds."""
    if request.node.get_closest_marker("serial"):
        return
    monkeypatch.setattr(answers, "PAUSE_LEAST_NS", 100_000_000)
    monkeypatch.setattr(answers, "PAUSE_MOST_NS", 150_000_000)

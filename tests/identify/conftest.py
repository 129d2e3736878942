"""One campaign of the simulator, and a copy of it that a test may spoil."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from support.simulated_sessions import simulate_sessions


@pytest.fixture(scope="session")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate_sessions(tmp_path_factory.mktemp("good") / "measured", "calibration")


@pytest.fixture
def measured(good: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(good, tmp_path / "measured"))

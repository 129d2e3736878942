"""The published sets, converted once."""

from __future__ import annotations

from pathlib import Path

import pytest
from convert import convert


@pytest.fixture(scope="session")
def converted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of every set's sessions and nominal arm, as `convert` lays them out."""
    folder = tmp_path_factory.mktemp("real")
    convert(folder)
    return folder

"""Two damaged inputs at every door; `make fuzz` tries them for minutes."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from fuzz.doors import Door, Fault
from fuzz.run import all_doors, fuzz


@pytest.mark.slow
def test_every_door_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    doors = all_doors(tmp_path)
    assert len(doors) > 35
    assert fuzz(doors, 1, math.inf, len(doors), tmp_path / "kept") == {}


def test_a_door_that_breaks_is_told_and_its_input_kept(tmp_path: Path) -> None:
    def enter(data: bytes) -> None:
        if data != b"0,1,2":
            raise Fault("broken")

    faults = fuzz([Door("weak", [b"0,1,2"], enter)], 1, math.inf, 50, tmp_path)
    assert sum(faults.values()) > 25
    assert len(list(tmp_path.iterdir())) == 1

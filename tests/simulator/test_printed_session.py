"""`armd simulate --session so101` gives all that its sessions need."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from armd.compensation.data.sessions.session import load_session
from armd.compensation.model.arm import load_arm
from armd.simulator.__main__ import main
from armd.simulator.printed import bench
from armd.simulator.sessions import INTERIM, KINDS, PRINTED
from support.pages import page_path

DOCUMENT = page_path("simulate")


def test_an_arm_toml_lies_beside_the_sessions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plate, seats = bench._plate_visits, bench._seat_visits  # all of them take half a minute
    monkeypatch.setattr(bench, "_plate_visits", lambda *args: plate(*args)[:1])
    monkeypatch.setattr(bench, "_seat_visits", lambda: seats()[:1])
    assert main(["--session", PRINTED, "-o", str(tmp_path / "s")]) == 0
    arm = load_arm(tmp_path / "s/arm.toml")
    for name in ("calibrate", "check", "verify"):
        described = tomllib.loads((tmp_path / "s" / name / "session.toml").read_text("utf-8"))
        assert described["arm"] == arm.serial_number
    assert load_session(tmp_path / "s/verify", arm).n > 0


def test_the_table_of_the_documentation_has_every_kind() -> None:
    table = set(re.findall(r"^\| `(\w+)` \|", DOCUMENT.read_text(encoding="utf-8"), re.MULTILINE))
    assert {*KINDS, INTERIM, PRINTED} <= table

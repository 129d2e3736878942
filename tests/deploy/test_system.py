"""armd on a controller: a Debian with systemd and udev, booted twice as a guest of this machine.

`make system-test` runs it. `make system-test BROKEN=1` puts a daemon into it that says it is ready
and does nothing else: then it must fail. guest/ holds what runs in the guest.
"""

from __future__ import annotations

import json
import os
import sys
import time
from typing import Any

import pytest
from guest_machine import Guest, machine
from payload import GUEST, make_payload

sys.path.insert(0, str(GUEST))
import stage_install
import stage_live

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]

STAGES = {"install": stage_install.CHECKS, "live": stage_live.CHECKS}
STAGE_S = 1500  # a stage takes two minutes under User-Mode Linux, and much longer under qemu


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """What each check of both stages reported, by name."""
    folder = tmp_path_factory.mktemp("guest")
    (folder / "payload").mkdir()
    make_payload(folder / "payload", folder)
    if os.environ.get("BROKEN"):
        (folder / "payload/broken").touch()
    guest = Guest(machine(folder), folder, folder / "payload")
    found: dict[str, dict[str, Any]] = {}
    for stage in STAGES:
        start_s = time.monotonic()
        results = guest.boot(stage, STAGE_S)
        print(f"{type(guest.machine).__name__} {stage}: {time.monotonic() - start_s:.0f} s")
        for report in json.loads((results / "results.json").read_text()):
            found[report["name"]] = report
            print(f"  {report['seconds']:6.1f} s {report['name']}: {report['detail']}")
    return found


@pytest.mark.parametrize("check", [check.__name__ for stage in STAGES.values() for check in stage])
def test_on_a_controller(reports: dict[str, dict[str, Any]], check: str) -> None:
    assert check in reports, "the guest did not report"
    assert reports[check]["passed"], reports[check]["detail"]

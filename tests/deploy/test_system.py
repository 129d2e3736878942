"""armd on a controller: a Debian with systemd and udev, booted as a guest of this machine.

`make system-test` runs it, under User-Mode Linux where that runs; `MACHINE=qemu` under qemu.
`BROKEN=1` puts a daemon into it that says it is ready and does nothing: then it must fail. What
only a USB port can show is shown under qemu in any case. guest/ holds what runs in the guest.
"""

from __future__ import annotations

import json
import os
import sys
import time
from typing import Any

import pytest
from guest_image import build_image, python_of
from guest_machine import Guest, machine
from guest_qemu import Qemu
from payload import GUEST, add_checks, make_payload

sys.path.insert(0, str(GUEST))
import stage_adapter
import stage_install
import stage_live
import stage_package

pytestmark = [pytest.mark.slow, pytest.mark.timeout(4 * 3600)]

STAGES = {
    "install": stage_install.CHECKS,
    "live": stage_live.CHECKS,
    "package": stage_package.CHECKS,
}
LEFT_OUT = {"passed": None, "detail": "not under qemu: half an hour of what needs no kernel's help"}
Reports = dict[str, dict[str, Any]]


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Reports:
    """What each check of every stage reported, by name, up to the stage that failed."""
    folder = tmp_path_factory.mktemp("guest")
    (folder / "payload").mkdir()
    guest_machine = machine(folder)
    make_payload(folder / "payload", folder, python_of(build_image(guest_machine.modules)))
    if os.environ.get("BROKEN"):
        (folder / "payload/broken").touch()
    guest = Guest(guest_machine, folder, folder / "payload")
    found: Reports = {}
    for stage, checks in STAGES.items():
        if stage == "package" and isinstance(guest_machine, Qemu):
            found |= {check.__name__: LEFT_OUT for check in checks}
            continue
        found |= run_stage(guest, stage)
        if not all(report["passed"] for report in found.values()):
            break  # what state it left the machine in, nobody knows
    return found


@pytest.fixture(scope="module")
def adapter_reports(tmp_path_factory: pytest.TempPathFactory) -> Reports:
    folder = tmp_path_factory.mktemp("adapter")
    (folder / "payload").mkdir()
    add_checks(folder / "payload")
    return run_stage(Guest(Qemu(), folder, folder / "payload"), "adapter")


def run_stage(guest: Guest, stage: str) -> Reports:
    """What each check of one stage reported, by name."""
    start_s = time.monotonic()
    results = guest.boot(stage)
    print(f"{type(guest.machine).__name__} {stage}: {time.monotonic() - start_s:.0f} s")
    reports = json.loads((results / "results.json").read_text())
    for report in reports:
        print(f"  {report['seconds']:6.1f} s {report['name']}: {report['detail']}")
    return {report["name"]: report for report in reports}


def verdict(reports: Reports, check: str) -> None:
    assert check in reports, "the guest did not report"
    if reports[check]["passed"] is None:
        pytest.skip(reports[check]["detail"])
    assert reports[check]["passed"], reports[check]["detail"]


@pytest.mark.parametrize("check", [check.__name__ for stage in STAGES.values() for check in stage])
def test_on_a_controller(reports: Reports, check: str) -> None:
    verdict(reports, check)


@pytest.mark.parametrize("check", [check.__name__ for check in stage_adapter.CHECKS])
def test_of_a_usb_adapter(adapter_reports: Reports, check: str) -> None:
    verdict(adapter_reports, check)

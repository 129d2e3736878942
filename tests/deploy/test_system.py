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
from concurrent.futures import ThreadPoolExecutor
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

STAGES = {
    "install": stage_install.CHECKS,
    "live": stage_live.CHECKS,
    "package": stage_package.CHECKS,
}
#: The stages of each controller, one boot after the other; the controllers run side by side.
CONTROLLERS = [["install", "live"], ["package"]]
TOLD_LINES = 60  # of the journal, where a check fails
LEFT_OUT = {"passed": None, "detail": "not under qemu: half an hour of what needs no kernel's help"}
Reports = dict[str, dict[str, Any]]


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> Reports:
    """What each check of every stage reported, by name; of a controller's up to what failed."""
    folder = tmp_path_factory.mktemp("guest")
    (folder / "payload").mkdir()
    guest_machine = machine(folder)
    make_payload(folder / "payload", folder, python_of(build_image(guest_machine.modules)))
    if os.environ.get("BROKEN"):
        (folder / "payload/broken").touch()
    controllers, found = CONTROLLERS, Reports()
    if isinstance(guest_machine, Qemu):
        controllers = CONTROLLERS[:1]
        found |= {check.__name__: LEFT_OUT for check in stage_package.CHECKS}

    def run_controller(stages: list[str]) -> Reports:
        (folder / stages[0]).mkdir()
        guest = Guest(guest_machine, folder / stages[0], folder / "payload")
        reports = Reports()
        for stage in stages:
            reports |= run_stage(guest, stage)
            if not all(report["passed"] for report in reports.values()):
                break  # what state it left the machine in, nobody knows
        return reports

    with ThreadPoolExecutor(len(controllers)) as side_by_side:
        for reports in side_by_side.map(run_controller, controllers):
            found |= reports
    return found


@pytest.fixture(scope="module")
def adapter_reports(tmp_path_factory: pytest.TempPathFactory) -> Reports:
    folder = tmp_path_factory.mktemp("adapter")
    (folder / "payload").mkdir()
    add_checks(folder / "payload")
    return run_stage(Guest(Qemu(), folder, folder / "payload"), "adapter")


def run_stage(guest: Guest, stage: str) -> Reports:
    """What each check of one stage reported, by name; a failure with what the journal says."""
    start_s = time.monotonic()
    results = guest.boot(stage)
    reports = json.loads((results / "results.json").read_text())
    lines = [f"{type(guest.machine).__name__} {stage}: {time.monotonic() - start_s:.0f} s"]
    lines += [
        f"  {report['seconds']:6.1f} s {report['name']}: {report['detail']}" for report in reports
    ]
    if not all(report["passed"] for report in reports):
        journal = (results / "journal.txt").read_text(errors="replace")
        lines += ["the end of the journal:", *journal.splitlines()[-TOLD_LINES:]]
    print("\n".join(lines))
    return {report["name"]: report for report in reports}


def verdict(reports: Reports, check: str) -> None:
    assert check in reports, "the guest did not report"
    if reports[check]["passed"] is None:
        pytest.skip(reports[check]["detail"])
    assert reports[check]["passed"], reports[check]["detail"]


def test_no_two_checks_have_one_name() -> None:
    """Reports are kept by name: of two, one would never be looked at."""
    names = [check.__name__ for stage in STAGES.values() for check in stage]
    names += [check.__name__ for check in stage_adapter.CHECKS]
    assert len(set(names)) == len(names) > 20


@pytest.mark.slow
@pytest.mark.timeout(4 * 3600)
@pytest.mark.parametrize("check", [check.__name__ for stage in STAGES.values() for check in stage])
def test_on_a_controller(reports: Reports, check: str) -> None:
    verdict(reports, check)


@pytest.mark.slow
@pytest.mark.timeout(4 * 3600)
@pytest.mark.parametrize("check", [check.__name__ for check in stage_adapter.CHECKS])
def test_of_a_usb_adapter(adapter_reports: Reports, check: str) -> None:
    verdict(adapter_reports, check)

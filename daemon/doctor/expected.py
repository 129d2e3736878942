"""Compare armd.toml's entries for a port with the devices that answer there."""

from __future__ import annotations

from pathlib import Path

from armd.daemon.doctor.finding import PortReport
from armd.drivers.config import ServoConfig

OTHERS = {"serial": "an arm of armd's own wire", "microscribe": "a MicroScribe"}


def compare(report: PortReport, file: Path, driver: ServoConfig) -> None:
    """Report each servo of *file* that does not answer, and another kind or rate."""
    if not report.protocol:
        return  # no device answers, which is reported already
    if report.protocol != driver.kind:
        device = OTHERS.get(report.protocol, f"{report.protocol} servos")
        text = f"{file}: driver.kind: found {driver.kind}, and {device} on the line"
        report.find("other_kind", text, f'kind = "{report.protocol}" under [driver] of {file}')
        return
    if report.baud != driver.baud:
        text = f"{file}: driver.baud: found {driver.baud}, and servos that speak at {report.baud}"
        report.find("other_baud", text, f"baud = {report.baud} under [driver] of {file}")
    answering = {int(servo["id"]) for servo in report.servos}
    for servo, purpose in list_named_servos(driver).items():
        if servo not in answering:
            report.find(
                "missing_id",
                f"servo {servo} ({purpose}) of {file}: found no answer, expected one",
                "check the cable before it, its power and its id; or correct [driver] in armd.toml",
            )
    for servo in sorted(answering - list_named_servos(driver).keys()):
        report.say(f"servo {servo} answers, and {file} does not name it")


def list_named_servos(driver: ServoConfig) -> dict[int, str]:
    """Return servo id → its purpose."""
    purposes = dict.fromkeys(driver.temperature_ids or [], "temperature_ids")
    if driver.trigger is not None:
        purposes[driver.trigger.id] = "trigger"
    return purposes | {servo: f"joint {k}" for k, servo in enumerate(driver.ids, 1)}

"""`armd doctor`: find the devices on this machine's ports and buses, and their problems."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from armd.daemon.config import load_config
from armd.daemon.doctor.examine import diagnose_port
from armd.daemon.doctor.expected import compare
from armd.daemon.doctor.finding import PortReport
from armd.daemon.doctor.machine import ThisMachine, list_can_buses
from armd.drivers.config import ServoConfig
from armd.drivers.poll.protocol.families import FAMILIES
from armd.drivers.ports import list_serial_ports
from armd.errors import BadInput
from armd.terminal.plain import make_moving_console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    target_group = parser.add_mutually_exclusive_group()
    target_group.add_argument(
        "--port", help="this serial port alone (default: all ports and CAN buses)"
    )
    target_group.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="armd.toml: the port of its servos, and whether all are there that it names",
    )
    parser.add_argument("--json", action="store_true", help="one object instead of text")


def run(args: argparse.Namespace) -> int:
    machine = ThisMachine()
    driver = _read_servos(args.config) if args.config else None
    port = args.port if driver is None else driver.port
    ports = [port] if port else [str(port) for port in list_serial_ports()]
    reports = []
    for port in ports:
        with make_moving_console(stderr=True).status(f"asking on {port} …"):
            reports.append(diagnose_port(port, machine))
    if driver is not None:
        compare(reports[0], args.config, driver)
    elif not args.port:
        reports += list_can_buses()
    if not reports:
        nothing = PortReport("this machine")
        text = "no serial adapter and no CAN interface is plugged in"
        nothing.find("no_port", text, "plug the arm in, then `armd doctor` again; lsusb shows USB")
        reports.append(nothing)
    troubled = any(report.findings for report in reports)
    if args.json:
        print(json.dumps({"ok": not troubled, "ports": [p.as_json() for p in reports]}, indent=1))
    else:
        _print(reports, troubled)
    return 1 if troubled else 0


def _read_servos(file: Path) -> ServoConfig:
    driver = load_config(file).driver
    if not isinstance(driver, ServoConfig):
        expected = f"one of {', '.join(FAMILIES)}: other arms are examined by --port"
        raise BadInput(file, "driver.kind", driver.kind, expected)
    return driver


def _print(reports: list[PortReport], troubled: bool) -> None:
    console = Console(soft_wrap=True, highlight=False)
    for report in reports:
        console.print(f"[bold]{escape(report.name)}[/bold]")
        for fact in report.facts:
            console.print(f"  {escape(fact)}")
        for finding in report.findings:
            console.print(f"  [red]✗[/red] {escape(finding.text)}")
            console.print(f"    do: {escape(finding.mend)}")
    if not troubled:
        console.print("nothing stands in the way")

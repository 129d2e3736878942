"""`armd status [SERIAL]`: show the state of a running daemon, for people and scripts.

Exit code 0: it measures (READY, WARMING); 1: it does not, or not well; 2: no daemon there.
"""

from __future__ import annotations

import argparse
import json
from typing import Any

import armd
from armd.daemon.commands.screen import format_sources, format_temperatures
from armd.daemon.host.root import WARNING
from armd.daemon.state import State
from armd.errors import BadInput
from armd.printable import to_printable
from armd.terminal.arguments import add_arm

GOOD = (State.READY, State.WARMING)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm(parser)
    parser.add_argument("--json", action="store_true", help="the whole health message")


def run(args: argparse.Namespace) -> int:
    with armd.connect(args.serial, args.endpoint, timeout_s=3.0) as arm:
        health = arm.state()
    if args.json:
        print(json.dumps(health))
    else:
        try:
            lines = _write_lines(health)
        except (KeyError, TypeError, AttributeError, ValueError) as error:
            problem = f"a message without {error!s}"
            raise BadInput(arm.serial, "health", problem, "one of armd's daemon") from error
        print("\n".join(to_printable(line) for line in lines))
    return 0 if health.get("state") in GOOD else 1


def _write_lines(health: dict[str, Any]) -> list[str]:
    drops = {name: n for name, n in health["drops"].items() if n and name != "samples"}
    lines = [
        f"{health['serial']}  {health['state']}: {health['reason']}",
        f"points       {health['rates']['points_hz']:g} Hz, {health['points']['published']}",
        f"sensors      {format_temperatures(health) or 'none'}",
        f"in use       {format_sources(health)}",
        f"drops        {', '.join(f'{n} {name}' for name, n in drops.items()) or 'none'}",
    ]
    if last := health.get("interim"):
        interim_text = last["reason"] or "no check known"
        if last["check"]:
            interim_text = (
                f"{last['check']}, {last['age_h']:.0f} h old, {last['state'].replace('_', ' ')}"
            )
        lines.append(f"interim      {interim_text}")
    return [*lines, *([f"warning      {WARNING}"] if health.get("as_root") else [])]

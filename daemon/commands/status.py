"""`armd status [SERIAL]`: how a running daemon does, for people and scripts.

Exit code 0: it measures (READY, WARMING); 1: not, or not well; 2: no daemon there.
"""

from __future__ import annotations

import argparse
import json

import armd
from armd.daemon.root import WARNING
from armd.daemon.screen import temperatures
from armd.daemon.state import State

GOOD = (State.READY, State.WARMING)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("serial", nargs="?", help="serial number (the one arm that is there)")
    parser.add_argument("--endpoint", default=armd.ENDPOINT, help=f"({armd.ENDPOINT})")
    parser.add_argument("--json", action="store_true", help="the whole health message")


def run(args: argparse.Namespace) -> int:
    with armd.connect(args.serial, args.endpoint, timeout_s=3.0) as arm:
        health = arm.health_now()
    state = State(health["state"])
    if args.json:
        print(json.dumps(health))
    else:
        print(f"{health['serial']}  {state}: {health['reason']}")
        print(f"points       {health['rates']['points_hz']:g} Hz, {health['points']['published']}")
        print(f"calibration  {health['calibration'] or 'none'}")
        print(f"sensors      {temperatures(health) or 'none'}")
        drops = {name: n for name, n in health["drops"].items() if n and name != "samples"}
        print(f"drops        {', '.join(f'{n} {name}' for name, n in drops.items()) or 'none'}")
        if health.get("as_root"):
            print(f"warning      {WARNING}")
    return 0 if state in GOOD else 1

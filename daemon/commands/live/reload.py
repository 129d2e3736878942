"""`armd reload [SERIAL]`: the daemon reads its calibration again, as on SIGHUP."""

from __future__ import annotations

import argparse

import armd
from armd.terminal.printable import printable


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("serial", nargs="?", help="serial number (the one arm that is there)")
    parser.add_argument("--endpoint", default=armd.ENDPOINT, help=f"({armd.ENDPOINT})")


def run(args: argparse.Namespace) -> int:
    with armd.connect(args.serial, args.endpoint) as arm:
        print(printable(f"{arm.serial}: {arm.command('reload')}"))
    return 0

"""`armd tip NAME [SERIAL]`: measure with another tip of the daemon's configuration."""

from __future__ import annotations

import argparse

import armd
from armd.printable import printable

OWN = "-"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "name", metavar="NAME", help=f"a tip of [tips] in armd.toml; {OWN}: the calibration's own"
    )
    parser.add_argument("serial", nargs="?", help="serial number (the one arm that is there)")
    parser.add_argument("--endpoint", default=armd.ENDPOINT, help=f"({armd.ENDPOINT})")


def run(args: argparse.Namespace) -> int:
    with armd.connect(args.serial, args.endpoint) as arm:
        done = arm.command("tip", name="" if args.name == OWN else args.name)
        print(printable(f"{arm.serial}: {done}"))
    return 0

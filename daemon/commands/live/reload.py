"""`armd reload [SERIAL]`: make the daemon read its calibration again, as on SIGHUP."""

from __future__ import annotations

import argparse

import armd
from armd.printable import to_printable
from armd.terminal.arguments import add_arm


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_arm(parser)


def run(args: argparse.Namespace) -> int:
    with armd.connect(args.serial, args.endpoint) as arm:
        print(to_printable(f"{arm.serial}: {arm.command('reload')}"))
    return 0

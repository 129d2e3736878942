"""`armd accept CONFIG`: accept the servos' settings that were read last as correct.

A running daemon notices it by itself.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from armd.daemon.config import load_config
from armd.drivers.config import ServoConfig
from armd.drivers.poll.protocol.families import FAMILIES
from armd.drivers.poll.servos.memory import Memory
from armd.errors import BadInput
from armd.terminal.counted import format_count


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("config", metavar="CONFIG", type=Path, help="armd.toml")


def run(args: argparse.Namespace) -> int:
    config = load_config(args.config)
    driver = config.driver
    if not isinstance(driver, ServoConfig):
        expected = f"one of {', '.join(FAMILIES)}: other arms' encoders have no offsets"
        raise BadInput(args.config, "driver.kind", driver.kind, expected)
    memory = Memory(config.arm.serial_number, FAMILIES[driver.kind])
    changes = memory.accept()
    for servo, phrases in changes.items():
        print(f"armd: servo {servo}: {'; '.join(phrases)}")
    print(f"armd: {memory.path}: {format_count(len(changes), 'servo')} changed, accepted as found")
    return 0

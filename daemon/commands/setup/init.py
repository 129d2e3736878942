"""`armd init FOLDER`: write a folder with arm.toml and armd.toml, each key explained."""

from __future__ import annotations

import argparse
import sys
import tomllib
from pathlib import Path

from armd.compensation.model.arm import Arm
from armd.daemon.catalogue.known_arms import (
    KNOWN,
    Bus,
    describe_geometry,
    read_arm_text,
    set_joint,
    set_serial_number,
    write_daemon_text,
)
from armd.daemon.catalogue.rows import CONVENTIONS, ROW, from_rows
from armd.daemon.catalogue.urdf.xml_tree import ROBOTS
from armd.daemon.config import load_config
from armd.errors import BadInput
from armd.files.outputs import ARM, OutputKind, add_force, check_output_folder, check_same
from armd.files.schema import validate
from armd.files.writing import write_whole
from armd.terminal.suggest import suggest_names

#: Option → the question if it is not given, and the answer that Enter means.
QUESTIONS = {
    "start_from": (f"which arm: {', '.join(KNOWN)}, a URDF, or a CSV of its rows", "so101"),
    "serial_number": ("what to call it (1 to 64 characters, 16 on the serial wire)", "ARM-1"),
    "port": ("its port (ls /dev/serial/by-id)", "/dev/ttyUSB0"),
}
COUNTS = 1 << 20
CONFIGURATION = OutputKind("an armd.toml", None)
ABOUT = """\
# What the arm is. Every key: docs/reference/formats.md. Check it: armd check arm.toml
# Joints stand from base to wrist; A = Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta), mm and degrees.
# Temperatures: a [[temperature_sensor]] with a name each, in the order of the wire's channels, and
# temperature = "NAME" in each joint that follows it.
# The tip's offset is the ball's centre in the last joint's frame; radius_mm is the ball's.
"""
DAEMON = """\
# The daemon's configuration. Every key: docs/reference/configure.md. Check it: armd check armd.toml
schema = "armd.daemon/1"
arm = "arm.toml"                        # beside this file
# calibration = "calibration.json"      # of armd calibrate; without it points carry flag 7

[driver]
kind = "serial"                         # or "can", "feetech", "dynamixel", "dynamixel1", …
port = "{port}"                         # best a name that stays: /dev/serial/by-id/...
baud = 2000000

[measurement]
trigger = "button"                      # or "rest": a measurement at each rest as well

[commands]
enabled = false                         # true: armd tip, armd reload and hosts may change things

# [tips.ball3]                          # tips to choose from while running: armd tip use ball3
# offset_mm = [0.0, 0.0, 120.0]
# radius_mm = 1.5
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="to write to; made if need be")
    parser.add_argument(
        "--from", dest="start_from", metavar="WHAT",
        help=f"a known arm ({', '.join(KNOWN)}), FILE.urdf, or a table of rows: {', '.join(ROW)}",
    )  # fmt: skip
    parser.add_argument("--tip-link", metavar="LINK", help="of a URDF: the link that touches")
    convention = parser.add_mutually_exclusive_group()
    for name, text in CONVENTIONS.items():
        convention.add_argument(
            f"--{name}", dest="convention", action="store_const", const=name,
            help=f"of a table of rows: its convention is {text}",
        )  # fmt: skip
    parser.add_argument("--serial-number", metavar="NAME", help="what to call this arm")
    parser.add_argument("--port", help="where it is plugged in")
    parser.add_argument(
        "--counts-per-turn", type=int, default=COUNTS, metavar="N",
        help=f"of encoders that the drawing does not tell of ({COUNTS})",
    )  # fmt: skip
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    check_output_folder(args.folder)
    for name in QUESTIONS:
        if getattr(args, name) is None:
            setattr(args, name, _ask_user(name))
    text, bus = _choose_arm(args)
    validate(f"--from {args.start_from}", tomllib.loads(text), Arm)
    daemon = DAEMON.format(port=args.port)
    if bus is not None:
        daemon = write_daemon_text("arm.toml", bus, args.port)
    args.folder.mkdir(parents=True, exist_ok=True)
    for name, kind, content in (("arm.toml", ARM, text), ("armd.toml", CONFIGURATION, daemon)):
        check_same(args.folder / name, content, kind, args.force)
    for name, content in (("arm.toml", text), ("armd.toml", daemon)):
        write_whole(args.folder / name, content)
    load_config(args.folder / "armd.toml")
    print(f"armd: {args.folder}: arm.toml and armd.toml written; look through both, then")
    print(f"  armd check {args.folder}/arm.toml {args.folder}/armd.toml")
    print(f"  armd run {args.folder}/armd.toml")
    if bus is None:
        print("still to be written into arm.toml: the tip's offset and radius, encoder directions")
    return 0


def _ask_user(name: str) -> str:
    """Return the answer of the person at the terminal, or the default for Enter.

    Without a terminal the default is used; raises `BadInput` for `--from`, which has none then.
    """
    question, default = QUESTIONS[name]
    if sys.stdin.isatty():
        return input(f"{question} [{default}]: ").strip() or default
    if name == "start_from":
        raise BadInput("the command line", "--from", "nothing", "an arm, a URDF or a table")
    return default


def _choose_arm(args: argparse.Namespace) -> tuple[str, Bus | None]:
    """Return arm.toml's text, and the bus of a known arm."""
    source = Path(args.start_from)
    bus = None
    remarks: list[str] = []
    if source.suffix.lower() in ROBOTS:
        from armd.daemon.catalogue.urdf.urdf import write_arm_toml  # imports scipy

        text, remarks = write_arm_toml(source, args.tip_link)
    elif source.suffix:
        text, remarks = from_rows(source, args.convention)
    else:
        name = args.start_from.lower().replace("_", "-")
        if name not in KNOWN:
            expected = f"FILE.urdf, FILE.csv, or a known arm{suggest_names(name, KNOWN)}"
            raise BadInput("the command line", "--from", args.start_from, expected)
        text, bus = read_arm_text(name), KNOWN[name]
        remarks.append(describe_geometry(text))
    for sentence in () if args.quiet else remarks:
        print(f"armd: {sentence}")
    joints = tomllib.loads(text)["joint"]
    unsaid = [k for k, joint in enumerate(joints, 1) if "counts_per_turn" not in joint]
    for k in unsaid:
        text = set_joint(text, k, {"counts_per_turn": args.counts_per_turn})
    if unsaid and not args.quiet:
        joint_text = ", ".join(map(str, unsaid))
        print(
            f"armd: counts_per_turn of joint {joint_text} is taken as {args.counts_per_turn}"
            " (--counts-per-turn); it matters on a live arm and for readings in counts"
        )
    if not text.startswith("#"):
        text = ABOUT + text
    return set_serial_number(text, args.serial_number), bus

"""`armd arm`: write the nominal geometry of a known arm as an arm.toml to start from."""

from __future__ import annotations

import argparse
import sys
import tomllib
from pathlib import Path

from rich.console import Console
from rich.table import Table

from armd.compensation.model.arm import Arm
from armd.daemon.catalogue import microscribe
from armd.daemon.catalogue.known_arms import (
    KNOWN,
    Bus,
    describe_geometry,
    find_spelling,
    load_known_arm,
    read_arm_text,
    read_title,
    set_serial_number,
    write_daemon_text,
)
from armd.daemon.catalogue.servos.lerobot import take_over
from armd.drivers.microscribe.factory import read_factory
from armd.drivers.microscribe.wire import BAUDS
from armd.drivers.ports import list_serial_ports
from armd.errors import BadInput
from armd.files.outputs import ARM, add_force, check_same
from armd.files.schema import validate
from armd.files.writing import check_place, write_whole
from armd.printable import to_printable

MICROSCRIBE = "MicroScribe 3D, 3DX, 3DL, G or G2: the factory's geometry, read from the arm"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "name",
        metavar="NAME",
        help="an arm of `armd arm list`; list; microscribe (its geometry is read from the arm at "
        "--port); or import-lerobot CALIBRATION.json",
    )
    parser.add_argument(
        "file", nargs="?", type=Path, metavar="CALIBRATION.json", help="of import-lerobot"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="ARM.toml",
        help="default: standard output. Beside it an armd.toml is written if there is none "
        "and the port is known",
    )
    parser.add_argument("--port", help="the serial port (default: the only one that is plugged in)")
    parser.add_argument(
        "--baud", type=int, choices=BAUDS, help="of microscribe (default: found by trying)"
    )
    parser.add_argument("--ball", action="store_true", help="microscribe: a ball tip, not a point")
    parser.add_argument("--serial-number", metavar="NAME", help="what to call this arm")
    parser.add_argument(
        "--arm", default="so101", metavar="NAME", help="of import-lerobot: which arm (so101)"
    )
    parser.add_argument(
        "--prefix", metavar="NAME_", help="of import-lerobot: of the arm's motors, as left_arm_"
    )
    parser.add_argument(
        "--short-sweep", action="append", default=[], metavar="JOINT",
        help="of import-lerobot: this joint turns no farther than it was swept",
    )  # fmt: skip
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    if args.file is not None and args.name != "import-lerobot":
        raise BadInput("armd arm", "arguments", str(args.file), f"nothing after {args.name}")
    if args.name == "list":
        _print_list()
        return 0
    bus: Bus | None = None
    if args.name == "import-lerobot":
        if args.file is None:
            raise BadInput("armd arm", "import-lerobot", "no file", "CALIBRATION.json")
        takeover = take_over(args.file, args.arm, args.prefix, args.short_sweep)
        text, bus = takeover.text, takeover.bus
        for sentence in () if args.quiet else takeover.remarks:
            print(f"armd: {to_printable(sentence)}", file=sys.stderr)
    elif args.name == "microscribe":
        return _set_up_microscribe(args)
    else:
        text, bus = read_arm_text(args.name), KNOWN[find_spelling(args.name)]
    if args.serial_number is not None:
        text = set_serial_number(text, args.serial_number)
        validate("--serial-number", tomllib.loads(text), Arm)
    if args.output is None:
        sys.stdout.write(text)
        return 0
    check_same(args.output, text, ARM, args.force, [args.file])
    write_whole(args.output, text)
    print(f"{args.output}: {read_title(text)}")
    if not args.quiet:
        print(to_printable(f"armd: {describe_geometry(text)}"), file=sys.stderr)
    if bus is not None:
        _write_daemon_file(args.output, bus, args.port)
    return 0


def _set_up_microscribe(args: argparse.Namespace) -> int:
    if args.serial_number is not None:
        raise BadInput("armd arm", "--serial-number", args.serial_number, "nothing: it has its own")
    ports = [args.port] if args.port else [str(port) for port in list_serial_ports()]
    if len(ports) != 1:
        raise BadInput("armd arm", "--port", f"{len(ports)} serial ports", "the MicroScribe's")
    if args.output is not None:
        check_place(args.output)  # before asking the arm, which takes seconds
    factory = read_factory(ports[0], args.baud)
    text = microscribe.write_arm_text(factory, ports[0], args.ball)
    validate(f"{ports[0]}: the arm's memory", tomllib.loads(text), Arm)
    if args.output is None:
        sys.stdout.write(text)
        return 0
    check_same(args.output, text, ARM, args.force)
    write_whole(args.output, text)
    print(f"{args.output}: {read_title(text)}")
    daemon_file = microscribe.write_daemon_text(args.output.name, ports[0], factory.baud)
    path = args.output.parent / "armd.toml"
    if path.exists():
        print(f"{path}: left as it is; its [driver] for this arm:", end="\n  ")
        print(*_read_driver(daemon_file), sep="\n  ")
        return 0
    write_whole(path, daemon_file)
    print(f"{path}: for `armd run {path}`, on {ports[0]}")
    return 0


def _write_daemon_file(output: Path, bus: Bus, port: str | None) -> None:
    """Write armd.toml beside arm.toml, unless it exists or the port is not certain."""
    path = output.parent / "armd.toml"
    if path.exists():
        print(
            f"{path}: left as it is; its [driver] for this arm:",
            *_write_driver(bus, port),
            sep="\n  ",
        )
        return
    ports = list_serial_ports() if port is None else [Path(port)]
    if len(ports) != 1:
        reason = "no serial port is plugged in" if not ports else f"{len(ports)} ports are there"
        print(f"{path}: not written, {reason}; with --port PORT it is. Its [driver]:", end="\n  ")
        print(*_write_driver(bus, port), sep="\n  ")
        return
    write_whole(path, write_daemon_text(output.name, bus, str(ports[0])))
    print(f"{path}: for `armd run {path}`, on {ports[0]}")


def _write_driver(bus: Bus, port: str | None) -> list[str]:
    return _read_driver(write_daemon_text("arm.toml", bus, port or "/dev/serial/by-id/…"))


def _read_driver(text: str) -> list[str]:
    """Return the lines of `[driver]` in an armd.toml that was made here."""
    lines = text.splitlines()
    return lines[lines.index("[driver]") + 1 :]


def _print_list() -> None:
    table = Table("name", "arm", "joints", "bus", "source", box=None)
    for name, bus in KNOWN.items():
        text = read_arm_text(name)
        wire = "-" if bus is None else f"{bus.kind}, {bus.baud} baud"
        table.add_row(
            name, read_title(text), str(load_known_arm(name).n_joints), wire, _name_source(text)
        )
    table.add_row("microscribe", MICROSCRIBE, "5", "microscribe", "the arm's own memory")
    Console(width=None if sys.stdout.isatty() else 250).print(table)


def _name_source(text: str) -> str:
    comment = " ".join(line.removeprefix("# ") for line in text.splitlines() if line[:1] == "#")
    return comment.partition("Source: ")[2].partition("; ")[0].partition(". Licence")[0]

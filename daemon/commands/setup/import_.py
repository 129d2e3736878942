"""`armd import TABLE`: convert a table of readings to a session, or a URDF to an arm.toml."""

from __future__ import annotations

import argparse
import datetime
import tempfile
from pathlib import Path
from typing import Any

from armd.compensation.data.foreign.columns import (
    NORMALISED,
    REFLECTOR,
    FoundColumns,
    Given,
    find_columns,
)
from armd.compensation.data.foreign.join_tables import WITHIN_S, join_tables
from armd.compensation.data.foreign.lerobot_dataset import is_dataset, read_dataset
from armd.compensation.data.foreign.phosphobot_episode import is_episode, read_episode
from armd.compensation.data.foreign.rosbag import is_bag, read_bag
from armd.compensation.data.foreign.table import TABLES, ForeignTable, read_table
from armd.compensation.data.foreign.words import LENGTHS
from armd.compensation.data.sessions.session import load_session
from armd.compensation.data.sessions.writing import write_session
from armd.compensation.model.arm import Arm, load_arm
from armd.daemon.catalogue.urdf.xml_tree import ROBOTS
from armd.errors import BadInput, shorten_text
from armd.files.outputs import (
    ARM,
    SESSION,
    SESSION_FILES,
    add_force,
    check_output_folder,
    check_outputs,
    check_same,
)
from armd.files.writing import write_whole
from armd.printable import to_printable
from armd.terminal.arguments import parse_positive
from armd.terminal.aside import make_aside
from armd.terminal.counted import format_count

#: Recordings of robots' own programs: the test that recognises one, and its reader.
RECORDED = ((is_dataset, read_dataset), (is_bag, read_bag), (is_episode, read_episode))


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "table",
        type=Path,
        metavar="FILE",
        help="a table (CSV, .xlsx), a LeRobot data set (folder, .parquet), a ROS 2 bag (folder,"
        " .mcap, .db3), an episode of phosphobot (.json), or a URDF",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="SESSION|ARM.toml")
    table = parser.add_argument_group("a table")
    table.add_argument("--arm", type=Path, metavar="ARM.toml", help="what was measured with")
    table.add_argument(
        "--column", action="append", default=[], type=_parse_column, metavar="NAME=HEADER",
        help="which column is which, where its name does not say so: q1='Joint one'",
    )  # fmt: skip
    table.add_argument("--sheet", metavar="NAME", help="of a workbook (the first)")
    table.add_argument(
        "--prefix", metavar="NAME",
        help="of one arm's joints, where the table has those of several: left_",
    )  # fmt: skip
    angles = table.add_mutually_exclusive_group()
    angles.add_argument("--angle-unit", choices=["rad", "deg", "count"], help="(by the header)")
    angles.add_argument(
        "--lerobot", type=Path, metavar="CALIBRATION.json",
        help="angles are LeRobot's, -100 to 100 of the sweeps in its calibration",
    )  # fmt: skip
    angles.add_argument(
        "--servo-zeros", type=Path, metavar="FILE",
        help="angles are those of phosphobot (its calibration, .json) or of GELLO (its .yaml), and"
        " become counts of the servos",
    )  # fmt: skip
    table.add_argument("--length-unit", choices=list(LENGTHS), help="of x, y, z (by the header)")
    table.add_argument(
        "--started", type=_parse_instant, metavar="TIME", help="2026-03-01T09:00 (UTC)"
    )
    table.add_argument(
        "--artefact",
        type=Path,
        metavar="FILE",
        help="its [artefact], a .toml, or its certificate's table (unknown fixed points)",
    )
    table.add_argument(
        "--points", type=Path, metavar="TABLE",
        help="x, y, z as a tracker wrote them, in a table of its own beside that of the joints",
    )  # fmt: skip
    table.add_argument(
        "--join", choices=["row", "time"],
        help="how both tables go together (by time where both have times, else by row)",
    )  # fmt: skip
    table.add_argument(
        "--within", type=parse_positive, metavar="SECONDS",
        help=f"most that a point and its joints are apart in time ({WITHIN_S:g})",
    )  # fmt: skip
    table.add_argument("--operator", metavar="NAME", help="who measured; reports name him or her")
    urdf = parser.add_argument_group("a URDF")
    urdf.add_argument("--tip-link", metavar="LINK", help="the link that touches (the last one)")
    add_force(parser)


def _read(args: argparse.Namespace) -> ForeignTable:
    """Return the table, of one arm; raises `BadInput`."""
    for is_one, read in RECORDED:
        if is_one(args.table):
            if args.sheet is not None:
                expected = "a workbook, which has sheets"
                raise BadInput(args.table, "--sheet", repr(args.sheet), expected)
            table = read(args.table)
            break
    else:
        table = read_table(args.table, args.sheet)
    return table if args.prefix is None else table.of_prefix(args.prefix)


def _parse_column(text: str) -> tuple[str, str]:
    name, equals, header = text.partition("=")
    if not (equals and name and header):
        raise argparse.ArgumentTypeError(f"found {text!r}, expected NAME=HEADER")
    return name, header


def _parse_instant(text: str) -> datetime.datetime:
    try:
        instant = datetime.datetime.fromisoformat(text)
    except ValueError as error:
        message = f"found {text!r}, expected a time as 2026-03-01T09:00:00Z"
        raise argparse.ArgumentTypeError(message) from error
    return instant if instant.tzinfo else instant.replace(tzinfo=datetime.UTC)


def run(args: argparse.Namespace) -> int:
    if args.table.suffix.lower() in ROBOTS:
        return _import_urdf(args)
    if args.arm is None:
        raise BadInput("the command line", "--arm", "nothing", "the arm.toml measured with")
    for option in ("join", "within"):
        if args.points is None and getattr(args, option) is not None:
            raise BadInput("the command line", f"--{option}", "no --points", "both tables")
    arm = load_arm(args.arm)
    artefact = None if args.artefact is None else _load_artefact(args)
    with make_aside(args).status("reading the table …"):
        table = _read(args)
        if args.points is not None:
            points = read_table(args.points)
            table = join_tables(table, points, arm, args.join, args.within or WITHIN_S)
    arguments = Given(
        dict(args.column),
        NORMALISED if args.lerobot else "rad" if args.servo_zeros else args.angle_unit,
        args.length_unit,
        args.started,
        [] if artefact is None else [target["name"] for target in artefact["target"]],
    )
    import_columns = find_columns(table, arm, arguments)
    remarks = [*table.assumed, *import_columns.remarks]
    if args.lerobot:
        remarks.append(_from_lerobot(args.lerobot, arm, import_columns, args.prefix))
    if args.servo_zeros:
        remarks.append(_from_servo_zeros(args.servo_zeros, arm, args.arm, import_columns))
    n = len(table.rows)
    content = _make_content(args, arm, import_columns, artefact, remarks)
    reflector = [REFLECTOR] if REFLECTOR in import_columns.texts else []
    names = ["time_s", "placement", "target", *reflector, *list_arm_columns(import_columns.numbers)]
    columns = {name: (import_columns.numbers | import_columns.texts)[name] for name in names}
    with make_aside(args).status("writing the session …"):
        _write(args, arm, content, columns)
    for sentence in () if args.quiet else remarks:
        print(f"armd: {shorten_text(to_printable(sentence))}")
    targets = format_count(len(set(import_columns.texts["target"])), "target")
    print(f"armd: {args.output}: {format_count(n, 'reading')}, {targets}")
    return 0


def list_arm_columns(numbers: dict[str, list[float]]) -> list[str]:
    """Return all column names but the time, the angles first."""
    return [name for name in numbers if name != "time_s"]


def _make_content(
    args: argparse.Namespace,
    arm: Arm,
    columns: FoundColumns,
    artefact: dict[str, Any] | None,
    remarks: list[str],
) -> dict[str, Any]:
    started = columns.started or args.started
    if started is None:
        modified_s = int(args.table.stat().st_mtime)
        started = datetime.datetime.fromtimestamp(modified_s, datetime.UTC)
        remarks.append(
            f"measured when the file was last changed: {started:%Y-%m-%d %H:%M}Z (--started)"
        )
    elif args.started is None:
        remarks.append(f"the first reading: {started:%Y-%m-%d %H:%M:%S}Z")
    if artefact is None:
        names = dict.fromkeys(columns.texts["target"])
        artefact = {"name": args.table.stem, "target": [{"name": name} for name in names]}
        remarks.append("the targets are fixed points at unknown places (--artefact FILE)")
    return {
        "schema": "armd.session/1",
        "arm": arm.serial_number,
        "started": started,
        "angle_unit": columns.angle_unit,
        "artefact": artefact,
    } | ({"operator": args.operator} if args.operator else {})


def _load_artefact(args: argparse.Namespace) -> dict[str, Any]:
    """Return the `[artefact]` of a TOML file, or of a certificate's table."""
    from armd.daemon.files.artefact_table import read_artefact_table
    from armd.daemon.files.session_folder import load_artefact

    if args.artefact.suffix.lower() in TABLES:
        artefact, remarks = read_artefact_table(args.artefact)
        for sentence in () if args.quiet else remarks:
            print(f"armd: {shorten_text(to_printable(sentence))}")
    else:
        artefact = load_artefact(args.artefact, [])
    content: dict[str, Any] = artefact.model_dump(mode="json", by_alias=True, exclude_none=True)
    return content


def _from_lerobot(path: Path, arm: Arm, columns: FoundColumns, prefix: str | None) -> str:
    """Replace LeRobot's normalised positions by angles; return a sentence about it."""
    from armd.daemon.catalogue.servos.lerobot_file import Normalised

    sweeps = Normalised(path, columns.joints, prefix)
    counts = all(joint.counts_per_turn == 4096 for joint in arm.joint)
    for name in columns.joints:
        columns.numbers[name] = [
            sweeps.count(name, value) if counts else sweeps.degrees(name, value)
            for value in columns.numbers[name]
        ]
    columns.angle_unit = "count" if counts else "deg"
    how = "counts of its servos" if counts else "degrees from the middle of each sweep"
    return f"-100 to 100 of the sweeps in {path.name} became {how}"


def _from_servo_zeros(path: Path, arm: Arm, arm_path: Path, columns: FoundColumns) -> str:
    """Replace another program's angles by servo counts; return a sentence about it.

    Raises `BadInput` for joints with another number of counts per turn.
    """
    from armd.daemon.catalogue.servos.zeros import COUNTS, read_servo_zeros

    for k, joint in enumerate(arm.joint, 1):
        if joint.counts_per_turn != COUNTS:
            found_text = str(joint.counts_per_turn or "nothing")
            location = f"joint[{k}].counts_per_turn"
            raise BadInput(arm_path, location, found_text, f"{COUNTS}, as --servo-zeros has")
    zeros = read_servo_zeros(path, arm.n_joints)
    for k in range(arm.n_joints):
        columns.numbers[f"q{k + 1}"] = zeros.counts(k, columns.numbers[f"q{k + 1}"])
    columns.angle_unit = "count"
    return f"{zeros.program}'s angles became counts of its servos by {path.name}"


def _write(args: argparse.Namespace, arm: Arm, content: dict[str, Any], columns: Any) -> None:
    """Write the session whole or not at all: a trial is read back first."""
    check_output_folder(args.output)
    if args.output.exists() and any(args.output.iterdir()) and not args.force:
        raise BadInput(args.output, "-o", "a folder that is not empty", "a new one (or --force)")
    for name in SESSION_FILES if args.output.is_dir() else ():
        inputs = [args.table, args.points, args.arm, args.artefact, args.lerobot, args.servo_zeros]
        check_outputs({"-o": (args.output / name, SESSION)}, inputs, args.force)
    with tempfile.TemporaryDirectory() as scratch:
        trial = Path(scratch) / args.output.name
        write_session(trial, content, columns)
        try:
            load_session(trial, arm)
        except BadInput as fault:
            raise BadInput(args.table, fault.where, fault.found, fault.expected) from fault
    write_session(args.output, content, columns)


def _import_urdf(args: argparse.Namespace) -> int:
    from armd.daemon.catalogue.urdf.urdf import write_arm_toml

    text, remarks = write_arm_toml(args.table, args.tip_link)
    check_same(args.output, text, ARM, args.force, [args.table])
    write_whole(args.output, text)
    for sentence in () if args.quiet else remarks:
        print(f"armd: {shorten_text(to_printable(sentence))}")
    print(f"armd: {args.output}: written; add the tip's radius and the encoders' counts per turn")
    return 0

"""`armd model`: write the calibrated arm's geometry as a file for other software."""

from __future__ import annotations

import argparse
import csv
import io
import json
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

from armd.compensation.geometry.corrections import Correction, list_corrections
from armd.compensation.geometry.geometry import Geometry, compute_geometry
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import LoadedCalibration, load_calibration
from armd.daemon.bridges.ros2 import urdf
from armd.daemon.bridges.ros2.node import make_legal_name
from armd.daemon.catalogue.universal_robots import (
    FIRST_LINE,
    LINKS,
    describe_omitted,
    write_kinematics_yaml,
)
from armd.daemon.catalogue.urdf.like import correct_urdf
from armd.errors import BadInput
from armd.files.outputs import ARM, RESULT, OutputKind, add_force, check_outputs, has_columns
from armd.files.writing import write_whole
from armd.printable import to_printable
from armd.terminal.counted import format_count
from armd.terminal.suggest import format_names

COLUMNS = list(Correction.__dataclass_fields__)
#: A URDF may be a person's work: it is never overwritten without --force.
URDF = OutputKind("a URDF", ARM.told_by)
KINEMATICS = OutputKind("a kinematics file of armd", lambda head: head[:23] == FIRST_LINE.encode())
CORRECTIONS = OutputKind("a table of corrections", has_columns("convention", "joint", "parameter"))
KINDS = {".urdf": URDF, ".yaml": KINEMATICS, ".json": RESULT, ".csv": CORRECTIONS}
#: Range of all temperatures that a sensor of an arm can have.
LEAST_C, MOST_C = -273.15, 1000.0
#: From this difference on, a message says that the original's tip differs from arm.toml's.
REMARKABLE_MM = 0.01


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("arm", type=Path, metavar="ARM.toml", help="what the arm is")
    parser.add_argument("--calibration", type=Path, metavar="CAL.json", help="without it: nominal")
    parser.add_argument(
        "--at-c", type=float, metavar="CELSIUS",
        help="temperature of all sensors (the calibration's reference temperature)",
    )  # fmt: skip
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE",
        help=".urdf; .yaml, Universal Robots' default_kinematics.yaml; .json or .csv, the "
        "corrections of each parameter",
    )  # fmt: skip
    like = parser.add_argument_group("a URDF of your own, corrected")
    like.add_argument(
        "--like", type=Path, metavar="ORIGINAL.urdf",
        help="its joints are moved, all else stays as it is; without it a new URDF",
    )  # fmt: skip
    like.add_argument("--base-link", metavar="LINK", help="where the arm begins (the root)")
    like.add_argument("--tip-link", metavar="LINK", help="the link that touches (the last one)")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    suffix = args.output.suffix.lower()
    if suffix not in KINDS:
        problem = f"the suffix {suffix!r}" if suffix else "no suffix"
        raise BadInput(args.output, "-o", problem, "one of " + ", ".join(KINDS))
    for option, value in (
        ("--like", args.like), ("--base-link", args.base_link), ("--tip-link", args.tip_link),
    ):  # fmt: skip
        if value is not None and (suffix != ".urdf" or args.like is None):
            expected = "it with --like ORIGINAL.urdf and a .urdf to write"
            raise BadInput("the command line", option, str(value), expected)
    if args.at_c is not None and not LEAST_C <= args.at_c <= MOST_C:
        expected = f"a temperature in °C, {LEAST_C:g} to {MOST_C:g}"
        raise BadInput("the command line", "--at-c", f"{args.at_c:g}", expected)
    outputs = {"-o": (args.output, KINDS[suffix])}
    check_outputs(outputs, [args.arm, args.calibration, args.like], args.force)
    arm = load_arm(args.arm)
    loaded = load_calibration(args.calibration, arm) if args.calibration else None
    if suffix == ".yaml" and arm.n_joints != len(LINKS):
        expected = "six, as Universal Robots' arms have"
        raise BadInput(args.arm, "joint", format_count(arm.n_joints, "joint"), expected)
    geometry = compute_geometry(arm, loaded.content if loaded else None, args.at_c)
    content, remarks = WRITERS[suffix](args, arm, loaded, geometry)
    write_whole(args.output, content)
    _print(args, loaded, geometry, remarks)
    return 0


def _write_urdf(
    args: argparse.Namespace, arm: Arm, loaded: LoadedCalibration | None, geometry: Geometry
) -> tuple[bytes | str, list[str]]:
    if args.like is None:
        prefix = make_legal_name(arm.serial_number)
        text = urdf.write_geometry(arm, geometry.parameters, prefix, f"{prefix}_base")
        return text, [f"a new URDF from {prefix}_base to {prefix}_ball"]
    edited = correct_urdf(args.like, arm, geometry.parameters, args.base_link, args.tip_link)
    if edited.nominal_mm > REMARKABLE_MM:
        drawn = (
            f"{args.like}: its tip is up to {edited.nominal_mm:.3g} mm from where {args.arm} has it"
            " without a calibration; is it the URDF that was imported?"
        )
        print(f"armd: {to_printable(drawn)}", file=sys.stderr)
    begin, end = edited.ends
    return edited.content, [
        f"the joints from {begin} to {end} of {args.like}; the tip moves by up to "
        f"{edited.moved_mm:.6g} mm",
        f"its tip and armd's differ by {edited.off_mm:.1e} mm and {edited.off_rad:.1e} rad at most"
        " over 1000 postures",
    ]


def _write_yaml(
    args: argparse.Namespace, arm: Arm, loaded: LoadedCalibration | None, geometry: Geometry
) -> tuple[bytes | str, list[str]]:
    identity = loaded.sha256[:16] if loaded else "nominal"
    text = write_kinematics_yaml(arm, geometry.parameters, arm.serial_number, identity)
    missing = describe_omitted(arm, geometry.parameters)
    remark = f"without what follows the last joint: {', '.join(missing)}" if missing else ""
    return text, [remark] if remark else []


def _write_json(
    args: argparse.Namespace, arm: Arm, loaded: LoadedCalibration | None, geometry: Geometry
) -> tuple[bytes | str, list[str]]:
    rows = [asdict(row) for row in _list_corrections(arm, loaded, geometry)]
    by_temperature = geometry.by_temperature
    content = {
        "schema": "armd.model/1",
        "arm": arm.serial_number,
        "calibration_sha256": loaded.sha256 if loaded else None,
        "temperature_c": geometry.celsius,
        "standard": [row for row in rows if row["convention"] == "standard"],
        "modified": [row for row in rows if row["convention"] == "modified"],
        "tip": [row for row in rows if row["joint"] == "tip"],
        "base": [row for row in rows if row["joint"] == "base"],
        "left_out": {
            **asdict(geometry.left_out),
            "terms": len(geometry.terms),
            "effects": _effects(geometry),
        },
        "by_temperature": by_temperature
        and {**asdict(by_temperature), "range_c": geometry.range_c},
    }
    return json.dumps(content, indent=1, allow_nan=False) + "\n", []


def _write_csv(
    args: argparse.Namespace, arm: Arm, loaded: LoadedCalibration | None, geometry: Geometry
) -> tuple[bytes | str, list[str]]:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(row) for row in _list_corrections(arm, loaded, geometry))
    return text.getvalue(), []


def _list_corrections(
    arm: Arm, loaded: LoadedCalibration | None, geometry: Geometry
) -> list[Correction]:
    return list_corrections(arm, loaded.content if loaded else None, geometry)


Writer = Callable[
    [argparse.Namespace, Arm, LoadedCalibration | None, Geometry], tuple[bytes | str, list[str]]
]
WRITERS: dict[str, Writer] = {
    ".urdf": _write_urdf,
    ".yaml": _write_yaml,
    ".json": _write_json,
    ".csv": _write_csv,
}


def _effects(geometry: Geometry) -> list[str]:
    return list(dict.fromkeys(term.effect or f"of {term.parameter}" for term in geometry.terms))


def _print(
    args: argparse.Namespace,
    loaded: LoadedCalibration | None,
    geometry: Geometry,
    remarks: list[str],
) -> None:
    """Print the content of the file, and what it lacks.

    The latter is a part of the result, so it is printed with -q, too.
    """
    geometry_name = "the calibrated geometry" if loaded else "arm.toml's geometry"
    if not args.quiet:
        print(f"armd: {args.output}: {geometry_name} at {geometry.celsius:g} °C")
    shown_remarks = [
        sentence for sentence in remarks if sentence.startswith("without") or not args.quiet
    ]
    for sentence in shown_remarks:
        print(f"armd: {to_printable(sentence)}")
    if geometry.terms:
        left_out = geometry.left_out
        print(
            f"armd: without {format_count(len(geometry.terms), 'term')} of the calibration"
            f" ({to_printable(format_names(_effects(geometry)))}); the geometry is the best without"
            f" them, and its tip differs by {left_out.rms_mm:.6f} mm RMS,"
            f" {left_out.max_mm:.6f} mm at most"
        )
    if geometry.by_temperature is not None and geometry.range_c is not None:
        low, high = geometry.range_c
        print(
            f"armd: at {low:g} and {high:g} °C the tip is up to"
            f" {geometry.by_temperature.max_mm:.6f} mm elsewhere: a geometry is of one temperature"
        )
        if not low <= geometry.celsius <= high:
            problem = f"{geometry.celsius:g} °C, outside the calibrated {low:g} to {high:g} °C"
            print(f"armd: --at-c: {problem}", file=sys.stderr)

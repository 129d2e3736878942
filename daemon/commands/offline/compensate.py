"""`armd compensate`: compute joint commands that bring the real tip to a wanted position."""

from __future__ import annotations

import argparse
import io
import math
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import numpy.typing as npt

from armd import Flag
from armd.arrays import Mask
from armd.compensation.data.correction.correction import Corrector
from armd.compensation.data.sessions.columns import APPROACH, read_angles, read_truths
from armd.compensation.data.sessions.format import AngleUnit
from armd.compensation.data.tables.readings import Readings, load_readings
from armd.compensation.inverse.compensate import OK, CommandedAngles, compensate
from armd.compensation.model.arm import Arm
from armd.compensation.model.state import States
from armd.daemon.commands.offline.given import (
    add_arm,
    add_session_settings,
    find_session_settings,
    load_given,
)
from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.files.outputs import OutputKind, add_force, check_outputs, has_columns
from armd.files.writing import write_whole
from armd.printable import to_printable
from armd.terminal.aside import make_aside
from armd.terminal.counted import format_count

COMMANDED = OutputKind(
    "a table of commands", has_columns("q1_command", "change_mm", "residual_mm", "status")
)
#: Decimals of the table's lengths in mm; smaller digits are rounding errors.
DECIMALS = 9


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "table", type=Path, metavar="TABLE.csv",
        help="columns q1 … qN, a nominal solution; x_mm, y_mm, z_mm, the wanted tip (without them "
        "where arm.toml's arm has it at these angles); temperatures by sensor name",
    )  # fmt: skip
    add_arm(parser)
    parser.add_argument("--calibration", metavar="CAL.json", help="without it: nominal")
    parser.add_argument("-o", "--output", required=True, type=Path, metavar="OUT.csv")
    add_session_settings(parser, "of q1 … qN and the commands")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    table: Path = args.table
    for path, location in ((table, "the file"), (args.output, "-o")):
        if path.suffix.lower() != ".csv":
            raise BadInput(path, location, f"the suffix {path.suffix!r}", "a .csv table")
    inputs = [table, table.parent / "session.toml", args.arm, args.calibration]
    check_outputs({"-o": (args.output, COMMANDED)}, inputs, args.force)
    model, model_under_test = load_given(args)
    arm, calibration = model.content, model_under_test.loaded if model_under_test else None
    unit, started_unix_s = find_session_settings(table, args.angle_unit, args.started)
    corrector = Corrector(arm, calibration, unit, started_unix_s)
    readings = load_readings(table, corrector.columns, [])
    repeated = [name for name in _name_columns(arm) if readings.has(name)]
    if repeated:
        problem = f"{repeated[0]} already"
        raise BadInput(table, "the header", problem, "a table without columns of commands")
    lines = _split_lines(readings)
    read_angles(readings, arm, unit)  # raises if one is missing
    batch = corrector.take(readings)
    corrector.ended(table)
    moving = _follows_rates(readings, batch.states)
    with make_aside(args).status("compensating …"):
        found_angles = compensate(arm, calibration, batch.states, read_truths(readings), moving)
    write_whole(args.output, _join_text(lines, found_angles, arm, unit))
    flags = corrector.correct(batch)[1]
    _print(args, found_angles, corrector.remarks, flags)
    return 0 if found_angles.is_ok.all() else 1


def _name_columns(arm: Arm) -> list[str]:
    commands = [f"q{k}_command" for k in range(1, arm.n_joints + 1)]
    return [*commands, "change_mm", "residual_mm", "status"]


def _follows_rates(readings: Readings, states: States) -> Mask:
    """Return (n,) whether the approach follows from the rates, not from the table."""
    given_approach = np.column_stack([readings.optional(name) for name in APPROACH])
    is_known = np.logical_and.reduce(np.isfinite(states.approach), axis=1)
    follows: Mask = is_known & np.logical_or.reduce(np.isnan(given_approach), axis=1)
    return follows


def _split_lines(readings: Readings) -> list[bytes]:
    """Return the table's lines, the header first.

    Raises `BadInput` where a row is not one line.
    """
    content = read_input(readings.path)
    lines = [line.rstrip(b"\r\n") for line in io.BytesIO(content) if line.strip()]
    if len(lines) != readings.n + 1:
        raise BadInput(readings.path, "a row", "a line break inside a value", "one line per row")
    return lines


def _join_text(lines: list[bytes], commanded: CommandedAngles, arm: Arm, unit: AngleUnit) -> bytes:
    """Return the table with its text unchanged and the new columns behind it."""
    scale = np.array([_get_radians(arm, k, unit) for k in range(arm.n_joints)])
    out = [lines[0] + b"," + ",".join(_name_columns(arm)).encode()]
    lengths = np.round(np.column_stack([commanded.change_mm, commanded.residual_mm]), DECIMALS)
    rows = zip(lines[1:], commanded.q / scale, lengths.tolist(), commanded.status, strict=True)
    for line, command, length, status in rows:
        numbers = [repr(x) if math.isfinite(x) else "" for x in [*command.tolist(), *length]]
        out.append(line + b"," + ",".join([*numbers, status]).encode())
    return b"\n".join([*out, b""])


def _get_radians(arm: Arm, k: int, unit: AngleUnit) -> float:
    """Return one unit of joint *k* (from 0) in radians, consistent with `read_angles`."""
    if unit == "count":
        joint = arm.joint[k]
        return joint.direction * math.tau / float(joint.counts_per_turn or 1)
    return 1.0 if unit == "rad" else math.radians(1.0)


def _print(
    args: argparse.Namespace,
    commanded: CommandedAngles,
    remarks: list[str],
    flags: npt.NDArray[np.uint32],
) -> None:
    for remark in remarks:
        print(to_printable(f"armd: {remark}"), file=sys.stderr)
    for flag, words in (
        (Flag.TEMPERATURE_RANGE, "a temperature or time outside what was calibrated"),
        (Flag.TEMPERATURE_STALE, "no temperature of a sensor in use: the last one is held"),
    ):
        if n := int((flags & int(flag) != 0).sum()):
            line = f"armd: {args.table}: {format_count(n, 'row')} with {words}"
            print(to_printable(line), file=sys.stderr)
    counts = Counter(commanded.status)
    fine = counts.pop(OK, 0)
    other_counts = "".join(f", {n} {status}" for status, n in sorted(counts.items()))
    largest = np.nanmax(np.where(commanded.is_ok, commanded.change_mm, np.nan), initial=0.0)
    print(
        f"{args.output}: {format_count(len(commanded.status), 'row')}: {fine} ok{other_counts};"
        f" the tip would have been off by up to {largest:.4f} mm"
    )

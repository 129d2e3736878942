"""`armd calibrate`: identify geometry and thermal model from sessions."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from pathlib import Path

from rich.table import Table

from armd.compensation.identify.result import Result
from armd.compensation.report.layout.about import add_about, read_about
from armd.compensation.report.layout.written import add_pages, list_page_outputs, write_pages
from armd.daemon.commands.offline.given import add_arm
from armd.files.outputs import CALIBRATION, RESULT, add_force, check_outputs
from armd.files.writing import write_whole
from armd.offline.arm_model import read_arm
from armd.offline.calibrate import METHODS, ORDERS, calibrate
from armd.terminal.aside import make_aside
from armd.terminal.counted import format_count
from armd.terminal.plain import make_plain_console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", nargs="+", help="session folders, at one or more temperatures")
    add_arm(parser)
    parser.add_argument("-o", "--output", required=True, metavar="CAL.json")
    parser.add_argument("--json", metavar="RESULT.json", help="figures of the identification")
    add_pages(parser)
    add_about(parser)
    parser.add_argument(
        "--thermal",
        choices=[order for order in ORDERS if order != "0"],
        default="auto",
        help="order of the thermal model; auto decides by the error on readings left out",
    )
    parser.add_argument(
        "--thermal-method",
        choices=METHODS,
        default="polynomial",
        help="polynomials of each joint's temperature, temperature zones, principal components,"
        " or identified at each temperature and regressed",
    )
    parser.add_argument(
        "--offset",
        action="store_true",
        help="per temperature: an offset C beside the value at the reference (default: C = 0)",
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    outputs = {
        "-o": (args.output, CALIBRATION),
        "--json": (args.json, RESULT),
        **list_page_outputs(args),
    }
    check_outputs(outputs, [args.arm, *args.session, args.about], args.force)
    about = read_about(args)
    arm = read_arm(args.arm)
    console = make_aside(args)
    with console.status("identifying …") as status:
        calibration = calibrate(
            args.session,
            arm,
            thermal=args.thermal,
            thermal_method=args.thermal_method,
            offset=args.offset,
            progress=status.update,
            command=shlex.join(["armd", *sys.argv[1:]]),
        )
    identified = calibration.identified
    assert identified is not None
    for session in identified.sessions:
        if session.unused_columns:
            names = ", ".join(session.unused_columns)
            console.print(f"{session.path}: columns not used: {names}")
    calibration.save(args.output)
    if args.json:
        write_whole(args.json, json.dumps(calibration.figures, indent=1) + "\n")
    write_pages(args, lambda: calibration.page(Path(args.output).name, about))
    _print(identified.result, f"{args.output} (calibration {calibration.sha256[:16]})")
    return 0


def _print(result: Result, written: str) -> None:
    console = make_plain_console()
    fit = result.fit
    console.print(
        f"{fit.observations.n} readings, {result.rms_um:.2f} µm 3-D RMS,"
        f" {result.heldout.in_words()} by leaving out {result.held_out_in_words} in turn;"
        f" rank {fit.solution.rank} of {len(fit.unknowns.names)}"
    )
    for length in result.lengths:
        console.print(f"certified length {length.in_words()}")
    for reflector in result.reflectors:
        console.print(reflector.in_words())
    if result.trials:
        table = Table("thermal model", "on readings left out")
        for trial in result.trials:
            table.add_row(trial.name, trial.errors.in_words())
        console.print(table)
        console.print(f"thermal order {result.thermal_order}")
    for line in result.unidentifiable:
        console.print(f"not identifiable: {line}")
    if len(fit.down_weighted):
        console.print(
            f"{format_count(len(fit.down_weighted), 'reading')} down-weighted,"
            f" {len(fit.outliers)} of them outliers"
            + (f": {fit.outlier_words()}" if len(fit.outliers) else "")
        )
    for note in result.notes:
        console.print(note)
    console.print(result.certificate.in_words(), soft_wrap=True)  # a command to copy
    console.print(f"written: {written}", soft_wrap=True)

"""`armd evaluate`: residuals of sessions under a model."""

from __future__ import annotations

import argparse
import json

from rich.console import Console
from rich.table import Table

from armd.compensation.data.session import load_sessions
from armd.compensation.identify.evaluate import evaluate
from armd.compensation.identify.requirements import ABSURD_RMS_MM
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import load_calibration
from armd.files import write_whole
from armd.outputs import RESULT, add_force, check_outputs


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", nargs="+", help="session folders")
    parser.add_argument("--arm", required=True, metavar="ARM.toml", help="what the arm is")
    parser.add_argument(
        "--calibration", metavar="CAL.json", help="default: the drawing in ARM.toml"
    )
    parser.add_argument("--json", metavar="OUT.json", help="the figures for programs")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    inputs = [args.arm, args.calibration, *args.session]
    check_outputs({"--json": (args.json, RESULT)}, inputs, args.force)
    arm = load_arm(args.arm)
    calibration = load_calibration(args.calibration, arm).content if args.calibration else None
    with Console(stderr=True).status("reading …") as status:
        sessions = load_sessions(args.session, arm)
        evaluation = evaluate(sessions, arm, calibration, status.update)
    result = evaluation.as_json()
    if args.json:
        write_whole(args.json, json.dumps(result, indent=1) + "\n")
    table = Table("session", "readings", "3-D RMS µm", "median µm", "maximum µm")
    for name, figures in [*result["by_session"].items(), ("all", result)]:
        if figures["n"]:
            values = (f"{figures[key]:.2f}" for key in ("rms_um", "median_um", "max_um"))
            table.add_row(name, str(figures["n"]), *values)
    console = Console()
    console.print(table)
    for length in evaluation.lengths:
        console.print(f"certified length {length.in_words()}")
    if result["rms_um"] > 1e3 * ABSURD_RMS_MM:
        console.print(
            f"residuals of {result['rms_um'] / 1e3:.0f} mm: {args.arm}: is it the drawing of this"
            " arm? (units of angles and lengths, directions, offsets)"
        )
    if result["n_unused"]:
        console.print(f"{result['n_unused']} readings lack a temperature the calibration needs")
    return 0

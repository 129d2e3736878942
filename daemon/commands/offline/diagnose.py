"""`armd diagnose`: find the model's errors and their causes; extend it; report the gain."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from typing import Any

from rich.table import Table

from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.report.result import as_json
from armd.compensation.model.calibration import save_calibration
from armd.compensation.report.layout.about import add_about, read_about
from armd.compensation.report.layout.written import add_pages, list_page_outputs, write_pages
from armd.daemon.commands.offline.given import add_arm, add_model_under_test, load_given
from armd.files.outputs import CALIBRATION, RESULT, add_force, check_outputs
from armd.files.writing import write_whole
from armd.offline.diagnose import diagnose
from armd.terminal.aside import make_aside, show_bar
from armd.terminal.plain import make_plain_console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", nargs="+", help="session folders")
    add_arm(parser)
    add_model_under_test(parser)
    parser.add_argument(
        "--holdout",
        nargs="+",
        default=[],
        metavar="SESSION",
        help="sessions for the gain alone; default: placements are left out in turn",
    )
    parser.add_argument("--json", metavar="OUT.json", help="the result for programs")
    add_pages(parser)
    add_about(parser)
    parser.add_argument("--extended", metavar="CAL2.json", help="the corrected calibration")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    outputs = {
        "--json": (args.json, RESULT),
        **list_page_outputs(args),
        "--extended": (args.extended, CALIBRATION),
    }
    inputs = [args.arm, args.calibration, *args.session, *args.holdout, args.about]
    check_outputs(outputs, inputs, args.force)
    about = read_about(args)
    arm, calibration = load_given(args)
    command = shlex.join(["armd", *sys.argv[1:]])
    with show_bar(make_aside(args), "reading") as report_progress:
        diagnosis = diagnose(
            args.session,
            arm,
            calibration,
            args.holdout or None,
            progress=report_progress,
            command=command,
        )
    result = as_json(diagnosis.details, args.extended)
    if args.json:  # with `predictive`, which takes a second or more
        result = diagnosis.to_dict() | {"extended_calibration": args.extended}
    if args.extended:
        save_calibration(args.extended, diagnosis.details.extended)
    write_pages(args, lambda: diagnosis.page(result, about))
    if args.json:
        write_whole(args.json, json.dumps(result, indent=1, allow_nan=False) + "\n")
    _print(diagnosis.details, result)
    return 0


def _print(diagnosis: Diagnosis, result: dict[str, Any]) -> None:
    console, findings = make_plain_console(), result["findings"]
    console.print(
        f"{diagnosis.rms_um:.2f} µm 3-D RMS, {diagnosis.heldout_rms_um:.2f} µm held out; "
        f"the noise alone: {diagnosis.noise_floor_um:.2f} µm"
    )
    if findings:
        table = Table("", "cause", "where", "probability", "held-out RMS, µm")
        for number, finding in enumerate(findings, 1):
            gain = finding["gain"]
            doubt = "" if gain["shown"] else " (not confirmed)"
            if finding["cause"] == "outliers":
                doubt = "" if diagnosis.holdout else " (without the rows named)"
            table.add_row(
                str(number),
                finding["cause"],
                finding["location"],
                f"{finding['probability']:.3f}",
                f"{gain['heldout_rms_um_before']:.2f} → {gain['heldout_rms_um_after']:.2f}{doubt}",
            )
        console.print(table)
        for number, finding in enumerate(findings, 1):
            rivals = ", ".join(
                f"{a['cause']} {a['location']} ({_format_share(a['probability'])})"
                for a in finding["alternatives"]
            )
            also = f"; could also be {rivals}" if rivals else ""
            console.print(f"{number}: {finding['reading']}{also}")
    console.print(result["verdict"])
    if result["cannot_tell"]:
        untold = ", ".join(row["cause"] for row in result["cannot_tell"])
        console.print(f"these data cannot tell: {untold} (--json and --report say what they need)")
    console.print(f"next: {result['next_experiment']}")


def _format_share(probability: float) -> str:
    """Format a probability for a person; a small one is not shown as zero."""
    return f"{probability:.2f}" if probability >= 0.01 else "under 0.01"

"""`armd diagnose`: what the model gets wrong, why, the extended model, the gain."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from armd.compensation.data.session import load_sessions
from armd.compensation.diagnose.diagnose import Diagnosis, diagnose
from armd.compensation.diagnose.result import as_json
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import load_calibration, save_calibration
from armd.compensation.report.written import add_pages, page_outputs, write_pages
from armd.files import write_whole
from armd.outputs import CALIBRATION, RESULT, add_force, check_outputs


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", nargs="+", help="session folders")
    parser.add_argument("--arm", required=True, metavar="ARM.toml", help="what the arm is")
    parser.add_argument(
        "--calibration",
        metavar="CAL.json",
        help="the model under test, held; default: what `armd calibrate` makes of the sessions",
    )
    parser.add_argument(
        "--holdout",
        nargs="+",
        default=[],
        metavar="SESSION",
        help="sessions for the gain alone; default: placements are left out in turn",
    )
    parser.add_argument("--json", metavar="OUT.json", help="the result for programs")
    add_pages(parser)
    parser.add_argument("--extended", metavar="CAL2.json", help="the mended calibration")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    outputs = {
        "--json": (args.json, RESULT),
        **page_outputs(args),
        "--extended": (args.extended, CALIBRATION),
    }
    inputs = [args.arm, args.calibration, *args.session, *args.holdout]
    check_outputs(outputs, inputs, args.force)
    arm = load_arm(args.arm)
    calibration = load_calibration(args.calibration, arm).content if args.calibration else None
    sessions = load_sessions(args.session, arm)
    holdout = load_sessions(args.holdout, arm, besides=sessions)
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True),
    )
    with bar:
        task = bar.add_task("reading", total=1.0)
        diagnosis = diagnose(
            sessions,
            arm,
            calibration,
            holdout,
            lambda text, share: bar.update(task, description=text, completed=share),
            shlex.join(["armd", *sys.argv[1:]]),
        )
        bar.update(task, description="done", completed=1.0)
    result = as_json(diagnosis, args.extended)
    if args.extended:
        save_calibration(args.extended, diagnosis.extended)
    write_pages(args, lambda: _page(diagnosis, result))
    if args.json:
        write_whole(args.json, json.dumps(result, indent=1, allow_nan=False) + "\n")
    _print(diagnosis, result)
    return 0


def _page(diagnosis: Diagnosis, result: dict[str, Any]) -> str:
    from armd.compensation.report.diagnosis import diagnosis_report  # drawings load slowly

    return diagnosis_report(diagnosis, result)


def _print(diagnosis: Diagnosis, result: dict[str, Any]) -> None:
    console, findings = Console(), result["findings"]
    console.print(
        f"{diagnosis.rms_um:.2f} µm 3-D RMS, {diagnosis.heldout_rms_um:.2f} µm held out; "
        f"the noise alone: {diagnosis.noise_floor_um:.2f} µm"
    )
    if findings:
        table = Table("", "cause", "where", "probability", "held-out RMS, µm")
        for number, finding in enumerate(findings, 1):
            gain = finding["gain"]
            doubt = "" if gain["shown"] else " (not borne out)"
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
                f"{a['cause']} {a['location']} ({_share(a['probability'])})"
                for a in finding["alternatives"]
            )
            also = f"; could also be {rivals}" if rivals else ""
            console.print(f"{number}: {finding['reading']}{also}")
    console.print(result["verdict"])
    if result["cannot_tell"]:
        untold = ", ".join(row["cause"] for row in result["cannot_tell"])
        console.print(f"these data cannot tell: {untold} (--json and --report say what they need)")
    console.print(f"next: {result['next_experiment']}")


def _share(probability: float) -> str:
    """A probability as a person reads it: what is small is not nothing."""
    return f"{probability:.2f}" if probability >= 0.01 else "under 0.01"

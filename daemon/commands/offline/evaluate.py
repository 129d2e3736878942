"""`armd evaluate`: compute residuals of sessions under a model."""

from __future__ import annotations

import argparse
import json
from typing import Any

from rich.table import Table

from armd.compensation.data.sessions.session import load_sessions
from armd.compensation.estimate.observations import collect_observations
from armd.compensation.identify.admission.mistakes import AssumedModel
from armd.compensation.identify.admission.requirements import ABSURD_RMS_MM
from armd.compensation.identify.admission.wrong_names import report_misnamed
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.daemon.commands.offline.given import add_arm, load_given
from armd.files.outputs import RESULT, add_force, check_outputs
from armd.files.writing import write_whole
from armd.offline.evaluate import evaluate
from armd.terminal.aside import make_aside
from armd.terminal.counted import format_count
from armd.terminal.plain import make_plain_console

#: More readings are not loaded at once only to explain large residuals.
MOST_HELD = 1_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", nargs="+", help="session folders")
    add_arm(parser)
    parser.add_argument(
        "--calibration", metavar="CAL.json", help="default: the drawing in ARM.toml"
    )
    parser.add_argument(
        "--fit-tip",
        action="store_true",
        help="fit the tip to these sessions first: another ball, or one that was seated again",
    )
    parser.add_argument("--json", metavar="OUT.json", help="the figures for programs")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    inputs = [args.arm, args.calibration, *args.session]
    check_outputs({"--json": (args.json, RESULT)}, inputs, args.force)
    model, model_under_test = load_given(args)
    with make_aside(args).status("reading …") as status:
        evaluation = evaluate(
            args.session, model, model_under_test, fit_tip=args.fit_tip, progress=status.update
        )
    result = evaluation.to_dict()
    if args.json:
        write_whole(args.json, json.dumps(result, indent=1) + "\n")
    table = Table("session", "readings", "3-D RMS µm", "median µm", "maximum µm")
    for name, figures in [*result["by_session"].items(), ("all", result)]:
        if figures["n"]:
            values = (f"{figures[key]:.2f}" for key in ("rms_um", "median_um", "max_um"))
            table.add_row(name, str(figures["n"]), *values)
    console = make_plain_console()
    console.print(table)
    for length in evaluation.lengths:
        console.print(f"certified length {length.in_words()}")
    for name, reflector in result["reflectors"].items():
        offset = ", ".join(f"{x:.4f}" for x in reflector["offset_mm"])
        console.print(f"reflector {name}: ({offset}) mm in the last frame")
    for remark in result["remarks"]:
        console.print(remark)
    if result["rms_um"] > 1e3 * ABSURD_RMS_MM:
        calibration = model_under_test.content if model_under_test else None
        console.print(_describe_why(args, model.content, calibration, result))
    if result["n_unused"]:
        unused = format_count(result["n_unused"], "reading")
        console.print(f"{unused} without a temperature that the calibration needs")
    return 0


def _describe_why(
    args: argparse.Namespace, arm: Arm, calibration: Calibration | None, result: dict[str, Any]
) -> str:
    """Describe possible reasons for residuals too large for an arm."""
    if result["n"] <= MOST_HELD:
        sessions = load_sessions(args.session, arm)
        observations = collect_observations(
            sessions, arm, calibration.artefact if calibration else None
        )
        reasons = report_misnamed(
            sessions, observations, AssumedModel.from_calibration(arm, calibration)
        )
        if reasons:
            return "\n".join(reasons)
    return (
        f"residuals of {result['rms_um'] / 1e3:.0f} mm: {args.arm}: is it the drawing of this"
        " arm? (units of angles and lengths, directions, offsets)"
    )

"""`armd verify`: ISO 10360-12 and ASME B89.4.22 results with a verdict."""

from __future__ import annotations

import argparse
import json

from rich.table import Table

from armd.compensation.data.session import Session, load_session
from armd.compensation.estimate.observations import gather
from armd.compensation.identify.admission.mistakes import AssumedModel
from armd.compensation.identify.admission.wrong_names import refuse_misnamed
from armd.compensation.model.arm import Arm
from armd.compensation.report.written import add_pages, page_outputs, write_pages
from armd.compensation.verify.figures import verify
from armd.compensation.verify.limits import PermissibleErrors, TestUncertainty, load_limits
from armd.compensation.verify.verdict import Verdict, judge
from armd.daemon.commands.offline.given import add_arm, load_given
from armd.errors import ArmdError
from armd.files.outputs import RESULT, add_force, check_outputs
from armd.files.writing import write_whole
from armd.terminal.aside import aside
from armd.terminal.plain import plain_console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", help="a session folder; its targets' names say which tests")
    add_arm(parser)
    parser.add_argument("--calibration", metavar="CAL.json", help="without it: nominal geometry")
    parser.add_argument("--mpe", metavar="MPE.toml", help="limits; without them no verdict")
    parser.add_argument(
        "--decision",
        choices=["guarded", "simple"],
        help="instead of the MPE file's: guarded by the uncertainty (ISO 14253-1), or simple",
    )
    parser.add_argument("--json", metavar="RESULT.json", help="all figures and the verdict")
    add_pages(parser)
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    outputs = {"--json": (args.json, RESULT), **page_outputs(args)}
    inputs = [args.arm, args.calibration, args.mpe, args.session]
    check_outputs(outputs, inputs, args.force)
    arm, calibration = load_given(args)
    limits = load_limits(args.mpe) if args.mpe else None
    if limits is not None and args.decision:
        limits = limits.model_copy(update={"decision": args.decision})
    session = load_session(args.session, arm)
    given = calibration.content if calibration else None
    observations = gather([session], arm, given.artefact if given else None)
    refuse_misnamed([session], observations, AssumedModel.under(arm, given))
    test = limits.uncertainty if limits else TestUncertainty()
    with aside(args).status("evaluating …"):
        verdict = judge(verify(session, arm, calibration, test), limits)
    if not verdict.judged:
        reasons = "; ".join(dict.fromkeys(verdict.verification.left_out.values()))
        raise ArmdError(f"{args.session}: no test is complete: {reasons}")
    if args.json:
        write_whole(args.json, json.dumps(verdict.as_json(), indent=1) + "\n")
    write_pages(args, lambda: _page(args, verdict, session, arm))
    _print(verdict, limits)
    return 0 if limits is None or verdict.passed else 1


def _page(args: argparse.Namespace, verdict: Verdict, session: Session, arm: Arm) -> str:
    from armd.compensation.report.verification import verification_report  # drawings load slowly

    files = {"arm": args.arm, "calibration": args.calibration, "limits": args.mpe}
    return verification_report(verdict, session, arm, files)


def _print(verdict: Verdict, limits: PermissibleErrors | None) -> None:
    console = plain_console()
    table = Table(box=None, pad_edge=False)
    for heading in ("Figure", "Standard"):
        table.add_column(heading)
    for heading in ("largest, µm", "deciding, µm", "MPE, µm", "U, µm", "n"):
        table.add_column(heading, justify="right")
    table.add_column("")
    for item in verdict.judged:
        table.add_row(
            item.figure.name,
            item.figure.standard,
            f"{1e3 * item.figure.worst.value_mm:+.1f}",
            f"{1e3 * item.deciding.value_mm:+.1f}",
            "" if item.limit_mm is None else f"{1e3 * item.limit_mm:.1f}",
            item.uncertainty_um(1).removesuffix(" µm"),
            str(len(item.figure.deviations)),
            item.outcome,
        )
    console.print(table)
    for key, reason in verdict.verification.left_out.items():
        status = "NOT TESTED, though it has a limit" if key in verdict.not_tested else "left out"
        console.print(f"{key}: {status}: {reason}")
    for remark in verdict.remarks:
        console.print(f"remark: {remark}")
    console.print(f"decision rule: {verdict.rule}")
    if limits is not None:
        console.print(f"verdict: {verdict.in_words}")

"""`armd verify`: compute results by ISO 10360-12 and ASME B89.4.22, with a verdict."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path

from rich.table import Table

from armd.compensation.data.foreign.table import TABLES
from armd.compensation.model.arm import load_arm
from armd.compensation.report.layout.about import About, add_about, read_about
from armd.compensation.report.layout.written import add_pages, list_page_outputs, write_pages
from armd.compensation.verify.limits import PermissibleErrors, TestUncertainty
from armd.compensation.verify.points import PointsVerification, verify_points
from armd.compensation.verify.verdict import Verdict, judge
from armd.daemon.commands.offline.given import load_given
from armd.daemon.files.session_folder import load_artefact
from armd.errors import BadInput
from armd.files.outputs import RESULT, add_force, check_outputs
from armd.files.writing import write_whole
from armd.offline.verify import require_judged, resolve_limits, verify
from armd.printable import to_printable
from armd.terminal.arguments import parse_positive
from armd.terminal.aside import make_aside
from armd.terminal.plain import make_plain_console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "session",
        help="a session folder, or a table of points (x_mm, y_mm, z_mm, target) that the arm's own"
        " host has written; the targets' names say which tests",
    )
    parser.add_argument("--arm", metavar="ARM.toml", help="what the arm is; of a session")
    parser.add_argument("--calibration", metavar="CAL.json", help="without it: nominal geometry")
    parser.add_argument("--mpe", metavar="MPE.toml", help="limits; without them no verdict")
    parser.add_argument(
        "--decision",
        choices=["guarded", "simple"],
        help="instead of the MPE file's: guarded by the uncertainty (ISO 14253-1), or simple",
    )
    points = parser.add_argument_group("a table of points")
    points.add_argument(
        "--artefact", type=Path, metavar="FILE.toml", help="its certified lengths ([artefact])"
    )
    points.add_argument(
        "--tip-radius-mm", type=parse_positive, metavar="R",
        help="of the ball, where the points are its centre's on a sphere (0: on the surface)",
    )  # fmt: skip
    parser.add_argument("--json", metavar="RESULT.json", help="all figures and the verdict")
    add_pages(parser)
    add_about(parser)
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    outputs = {"--json": (args.json, RESULT), **list_page_outputs(args)}
    inputs = [args.arm, args.calibration, args.mpe, args.session, args.artefact, args.about]
    check_outputs(outputs, inputs, args.force)
    about = read_about(args)
    limits = resolve_limits(args.mpe, args.decision)
    if Path(args.session).suffix.lower() in TABLES and not Path(args.session).is_dir():
        return _verify_points(args, limits, about)
    for option, value in (("--artefact", args.artefact), ("--tip-radius-mm", args.tip_radius_mm)):
        if value is not None:
            raise BadInput("the command line", option, "it with a session", "it with a table")
    if args.arm is None:
        raise BadInput("the command line", "--arm", "nothing", "the arm.toml measured with")
    arm, calibration = load_given(args)
    with make_aside(args).status("evaluating …"):
        result = verify(args.session, arm, calibration, args.mpe, decision=args.decision)
    return _finish(args, result.details, limits, lambda: result.page(about))


def _verify_points(args: argparse.Namespace, limits: PermissibleErrors | None, about: About) -> int:
    """Verify a table of points; an arm.toml only adds the radius of its tip."""
    if args.calibration is not None:
        expected = "it with a session: a table has points, and no joint angles"
        raise BadInput("the command line", "--calibration", "it with a table", expected)
    artefact = None if args.artefact is None else load_artefact(args.artefact, [])
    test = limits.uncertainty if limits else TestUncertainty()
    radius_mm = args.tip_radius_mm or (load_arm(args.arm).tip.radius_mm if args.arm else 0.0)
    path = Path(args.session)
    verification = verify_points(path, artefact, radius_mm, test, judged=limits is not None)
    for sentence in () if args.quiet else verification.messages:
        print(f"armd: {to_printable(sentence)}")
    verdict = judge(verification.verification, limits)
    require_judged(verdict, args.session)
    return _finish(args, verdict, limits, lambda: _render_page(args, verdict, verification, about))


def _finish(
    args: argparse.Namespace,
    verdict: Verdict,
    limits: PermissibleErrors | None,
    page: Callable[[], str],
) -> int:
    if args.json:
        write_whole(args.json, json.dumps(verdict.as_json(), indent=1) + "\n")
    write_pages(args, page)
    _print(verdict, limits)
    return 0 if limits is None or verdict.passed else 1


def _render_page(
    args: argparse.Namespace, verdict: Verdict, verification: PointsVerification, about: About
) -> str:
    from armd.compensation.report.sessions import InputFile
    from armd.compensation.report.verification.page import (
        make_verification_report,  # slow to load
    )

    files = {"arm": InputFile.read(args.arm), "limits": InputFile.read(args.mpe)}
    return make_verification_report(verdict, verification.session, verification.arm, files, about)


def _print(verdict: Verdict, limits: PermissibleErrors | None) -> None:
    console = make_plain_console()
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

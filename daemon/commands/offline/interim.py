"""`armd interim`: judge short checks over time: the arm is in control, or has changed."""

from __future__ import annotations

import argparse
import csv
import io
import json
import math
import shlex
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from armd.compensation.data.sessions.session import load_sessions
from armd.compensation.interim.checks import chain, history, keeping
from armd.compensation.interim.checks.admission import refuse_unfit
from armd.compensation.interim.checks.columns import list_causes
from armd.compensation.interim.checks.reduce import reduce
from armd.compensation.interim.report.judge import judge
from armd.compensation.interim.report.judgement import Judgement
from armd.compensation.interim.report.next_check import NextCheck, plan_next_check
from armd.compensation.interim.report.result import as_json, describe_judgement
from armd.compensation.interim.report.single import list_single_readings
from armd.compensation.interim.report.watch_memory import read_memory, write_memory
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import load_calibration, save_calibration
from armd.compensation.report.layout.about import About, add_about, read_about
from armd.compensation.report.layout.written import add_pages, list_page_outputs, write_pages
from armd.daemon.commands.offline import interim_points
from armd.errors import BadInput
from armd.files.outputs import POSES, RESULT, add_force, check_outputs
from armd.files.writing import write_changed, write_whole
from armd.terminal.aside import make_aside, show_bar

#: A history folder's calibration with the expansion of the links, if the active calibration
#: could not determine it.
GROWTH = "calibration-growth.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    add = actions.add_parser("add", help="keep a check and judge the whole history")
    add.add_argument(
        "session",
        nargs="+",
        metavar="SESSION",
        help="session folders of checks, or tables of points (x_mm, y_mm, z_mm, target)",
    )
    add.add_argument("--arm", metavar="ARM.toml", help="what the arm is; of sessions")
    add.add_argument(
        "--calibration",
        metavar="CAL.json",
        help="the calibration that the checks are of; another one begins an epoch of its own",
    )
    interim_points.add_arguments(add)
    add.add_argument("--history", required=True, metavar="DIR", help="the folder that keeps them")
    add.add_argument(
        "--future",
        action="store_true",
        help="do not ask this computer's clock: take checks that are dated after now, as simulated"
        " ones may be, and checks added after the clock was set back",
    )
    add.add_argument("--json", action="store_true", help="print the result for programs")
    report = actions.add_parser("report", help="what the history says")
    report.add_argument("--history", required=True, metavar="DIR", help="the folder of checks")
    report.add_argument(
        "--json",
        nargs="?",
        const="-",
        metavar="OUT.json",
        help="the result for programs, to a file or (no file named) printed",
    )
    report.add_argument(
        "--poses", metavar="POSES.csv", help="poses of the next check, where a cause is in doubt"
    )
    add_pages(report)
    add_about(report)
    add_force(report)


def run(args: argparse.Namespace) -> int:
    return _add(args) if args.action == "add" else _report_history(args)


def _add(args: argparse.Namespace) -> int:
    if interim_points.are_tables(args.session):
        return interim_points.add(args)
    interim_points.refuse_options(args)
    for option, value, expected in (
        ("--arm", args.arm, "the arm.toml measured with"),
        ("--calibration", args.calibration, "the calibration that the checks are of"),
    ):
        if value is None:
            raise BadInput("the command line", option, "nothing", expected)
    folder = Path(args.history)
    arm = load_arm(args.arm)
    calibration = load_calibration(args.calibration, arm)
    sessions = load_sessions(args.session, arm)
    dated = [keeping.CheckDate.from_session(session) for session in sessions]
    if not args.future:
        keeping.check_past(dated, math.floor(time.time()))
    # Checked twice: here for a quick answer, and again later, when no other process may write.
    lines = chain.read_chain(folder).lines
    if not args.future:
        keeping.check_clock(folder, lines, math.floor(time.time()))
    keeping.check_new(folder, lines, dated)
    remarks = refuse_unfit(sessions, arm, calibration.content)
    causes = list_causes(arm, calibration.content)
    console, new = make_aside(args), []
    with show_bar(console, "evaluating the checks") as report_progress:
        for number, session in enumerate(sessions, 1):
            new.append(keeping.NewCheck(session, reduce(session, arm, calibration.content, causes)))
            report_progress("evaluating the checks", number / len(sessions))
    with keeping.lock_history(folder), console.status("judging the history …"):
        lines = chain.read_chain(folder).lines
        before = history.load(folder) if lines else []  # raises for a damaged history
        keeping.check_new(folder, lines, dated)
        keeping.keep(folder, lines, new, Path(args.arm), calibration)
        try:
            judgement, result, _ = _judge_history(folder, before)
        except BadInput as error:  # for example no room for the report
            advice = f"{error.expected} (the checks are kept: armd interim report judges them)"
            raise BadInput(error.file, error.where, error.found, advice) from error
    for remark in filter(None, [*remarks, keeping.report_early_dates(lines, dated)]):
        console.print(f"armd: {remark}", soft_wrap=True, markup=False, highlight=False)
    _print_result(folder, judgement, result, "-" if args.json else None)
    return 1 if judgement.changed else 0


def _report_history(args: argparse.Namespace) -> int:
    to_file = args.json if args.json != "-" else None
    check_outputs(
        {
            "--json": (to_file, RESULT),
            **list_page_outputs(args),
            "--poses": (args.poses, POSES),
        },
        [args.about],
        args.force,
    )
    about = read_about(args)
    folder = Path(args.history)
    if chain.is_of_points(folder):
        return interim_points.report(args, to_file, about)
    with make_aside(args).status("judging the history …"):
        judgement, result, after = _judge_history(folder)
    if args.poses:
        write_whole(args.poses, _write_poses(after))
    write_pages(args, lambda: _render_page(folder, judgement, result, about))
    if to_file:
        write_whole(to_file, json.dumps(result, indent=1, allow_nan=False) + "\n")
    _print_result(folder, judgement, result, args.json)
    return 1 if judgement.changed else 0


def _render_page(folder: Path, judgement: Judgement, result: dict[str, Any], about: About) -> str:
    from armd.compensation.interim.report.page import render_interim_page  # slow to load

    sessions = [history.load_measured(folder, check) for check in judgement.checks]
    return render_interim_page(judgement, result, sessions, about)


def _judge_history(
    folder: Path, before: Sequence[history.Check] = ()
) -> tuple[Judgement, dict[str, Any], NextCheck]:
    """Judge a history, and write its changes' calibrations and the result beside it.

    *before* are checks that are already loaded.
    """
    judgement = judge(history.load(folder, before), read_memory(folder))
    judgement = replace(judgement, far_off=tuple(list_single_readings(folder, judgement)))
    files: list[tuple[str, str] | None] = []
    for finding in (finding for epoch in judgement.epochs for finding in epoch.reported_changes):
        if finding.calibration is None:
            files.append(None)
            continue
        name = f"calibration-{len(files) + 1}.json"
        saved = save_calibration(folder / name, finding.calibration, write_changed)
        files.append((name, saved.sha256))
    after = plan_next_check(judgement)
    with_growth = None
    if (grown := judgement.latest.grown) is not None:
        saved = save_calibration(folder / GROWTH, grown.calibration, write_changed)
        with_growth = GROWTH, saved.sha256
    result = as_json(judgement, files, after.as_json(), with_growth)
    write_changed(folder / chain.REPORT, json.dumps(result, indent=1, allow_nan=False) + "\n")
    write_memory(folder, judgement)
    return judgement, result, after


def _write_poses(after: NextCheck) -> str:
    """Return the next check's poses as a table for `armd measure poses`."""
    if after.advised is None:
        raise BadInput("--poses", "the next check", "no poses of its own", "a cause in doubt")
    states, seats = after.advised.states, after.advised.seats_mm
    text = io.StringIO()
    joints = range(1, states.q.shape[1] + 1)
    sides = [f"approach_joint_{k}" for k in joints]
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["pose", "x_mm", "y_mm", "z_mm", *(f"q{k}_deg" for k in joints), *sides])
    rows = zip(np.degrees(states.q), after.advised.approach, strict=True)
    for i, (q, turned) in enumerate(rows, 1):
        tip = seats[(i - 1) % len(seats)]
        writer.writerow([i, *(f"{v:.1f}" for v in tip), *(f"{v:.2f}" for v in q), *turned])
    return text.getvalue()


def _print_result(
    folder: Path, judgement: Judgement, result: dict[str, Any], to: str | None
) -> None:
    if to == "-":
        print(json.dumps(result, indent=1, allow_nan=False))
        return
    for line in describe_judgement(judgement):
        print(line)
    if result["growth"]:
        print(f"calibration with the growth: {GROWTH} (in the history's folder)")
    for change in result["changes"]:
        if change["calibration_from"]:
            print(f"corrected calibration: {change['calibration_from']} (in the history's folder)")
    # Changes of earlier epochs are part of the present calibration of the checks.
    open_ones = [c for c in result["changes"] if c["judged_under"] == result["calibration"]]
    mended = [c["calibration_from"] for c in open_ones if c["calibration_from"]]
    if mended:
        since = min(change["between"][0] for change in open_ones)
        print(
            "to correct what was measured since: armd recorrect MEASUREMENTS --arm ARM.toml "
            f"--calibration {shlex.quote(str(folder / mended[-1]))} --since {since} -o again.csv"
        )
    print(f"next: {result['next_check']['sentence']}")
    if result["next_check"]["poses_deg"]:
        folder_text = shlex.quote(str(folder))
        print(f"to measure it: armd measure interim --proposed --history {folder_text} -o SESSION")

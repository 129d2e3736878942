"""`armd interim`: short checks over time, and what they say: in control, or changed."""

from __future__ import annotations

import argparse
import csv
import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from armd.compensation.data.session import load_sessions
from armd.compensation.interim import history
from armd.compensation.interim.columns import causes_of
from armd.compensation.interim.judge import Judgement, judge
from armd.compensation.interim.reduce import reduce
from armd.compensation.interim.result import as_json, in_words
from armd.compensation.interim.tomorrow import Tomorrow, tomorrow
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import load_calibration, save_calibration
from armd.errors import BadInput
from armd.files import write_whole
from armd.outputs import PAGE, POSES, RESULT, add_force, check_outputs

#: In a history's folder: the last result, for the daemon and for programs.
REPORT = "report.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", required=True, metavar="ACTION")
    add = actions.add_parser("add", help="keep a check and judge the whole history")
    add.add_argument("session", nargs="+", metavar="SESSION", help="session folders of checks")
    add.add_argument("--arm", required=True, metavar="ARM.toml", help="what the arm is")
    add.add_argument(
        "--calibration",
        required=True,
        metavar="CAL.json",
        help="the calibration that the checks are of; another one begins an epoch of its own",
    )
    add.add_argument("--history", required=True, metavar="DIR", help="the folder that keeps them")
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
    report.add_argument("--report", metavar="R.html", help="a report that opens offline")
    add_force(report)


def run(args: argparse.Namespace) -> int:
    return _add(args) if args.action == "add" else _report(args)


def _add(args: argparse.Namespace) -> int:
    folder = Path(args.history)
    arm = load_arm(args.arm)
    calibration = load_calibration(args.calibration, arm)
    sessions = load_sessions(args.session, arm)
    # Twice: before the long part for a quick answer, and again when nobody else may write.
    lines = history.read_lines(folder)
    history.check_new(folder, lines, sessions)
    causes = causes_of(arm, calibration.content)
    new = [history.New(s, reduce(s, arm, calibration.content, causes)) for s in sessions]
    with history.locked(folder):
        lines = history.read_lines(folder)
        if lines:
            history.load(folder)  # a damaged history takes no more
        history.check_new(folder, lines, sessions)
        history.keep(folder, lines, new, Path(args.arm), calibration)
        judgement, result, _ = _judged(folder)
    _say(judgement, result, "-" if args.json else None)
    return 1 if judgement.changed else 0


def _report(args: argparse.Namespace) -> int:
    to_file = args.json if args.json != "-" else None
    check_outputs(
        {
            "--json": (to_file, RESULT),
            "--report": (args.report, PAGE),
            "--poses": (args.poses, POSES),
        },
        [],
        args.force,
    )
    folder = Path(args.history)
    judgement, result, after = _judged(folder)
    if args.poses:
        write_whole(args.poses, _poses(after))
    if args.report:
        from armd.compensation.interim.page import interim_page

        write_whole(args.report, interim_page(judgement, result))
    if to_file:
        write_whole(to_file, json.dumps(result, indent=1, allow_nan=False) + "\n")
    _say(judgement, result, args.json)
    return 1 if judgement.changed else 0


def _judged(folder: Path) -> tuple[Judgement, dict[str, Any], Tomorrow]:
    """Judge a history; its changes' calibrations and the result are written beside it."""
    judgement = judge(history.load(folder))
    files: list[tuple[str, str] | None] = []
    for told in (told for epoch in judgement.epochs for told in epoch.told):
        if told.calibration is None:
            files.append(None)
            continue
        name = f"calibration-{len(files) + 1}.json"
        files.append((name, save_calibration(folder / name, told.calibration).sha256))
    after = tomorrow(judgement)
    result = as_json(judgement, files, after.as_json())
    write_whole(folder / REPORT, json.dumps(result, indent=1, allow_nan=False) + "\n")
    return judgement, result, after


def _poses(after: Tomorrow) -> str:
    """The next check's poses, as a table that `armd measure poses` takes."""
    if after.states is None or after.tip_mm is None:
        raise BadInput("--poses", "the next check", "no poses of its own", "a cause in doubt")
    text = io.StringIO()
    joints = range(1, after.states.q.shape[1] + 1)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["pose", "x_mm", "y_mm", "z_mm", *(f"q{k}_deg" for k in joints)])
    for i, (tip, q) in enumerate(zip(after.tip_mm, np.degrees(after.states.q), strict=True), 1):
        writer.writerow([i, *(f"{v:.1f}" for v in tip), *(f"{v:.2f}" for v in q)])
    return text.getvalue()


def _say(judgement: Judgement, result: dict[str, Any], to: str | None) -> None:
    if to == "-":
        print(json.dumps(result, indent=1, allow_nan=False))
        return
    for line in in_words(judgement):
        print(line)
    for change in result["changes"]:
        if change["calibration_from"]:
            print(f"mended calibration: {change['calibration_from']} (in the history's folder)")
    print(f"next: {result['next_check']['sentence']}")

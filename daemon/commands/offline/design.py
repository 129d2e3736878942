"""`armd design`: the poses to measure next."""

from __future__ import annotations

import argparse
import csv
import io
import json
from typing import Any

from rich.table import Table

from armd.compensation.design.design import FEW, MANY, Experiment
from armd.compensation.report.written import add_pages, page_outputs, write_pages
from armd.daemon.commands.offline.given import add_arm, add_model_under_test, load_given
from armd.files.outputs import POSES, RESULT, add_force, check_outputs
from armd.files.writing import write_whole
from armd.offline.design import check_readings, design
from armd.terminal.aside import aside, bar
from armd.terminal.plain import plain_console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("session", nargs="+", help="sessions measured so far")
    add_arm(parser)
    add_model_under_test(parser)
    parser.add_argument(
        "--poses",
        type=int,
        help=f"how many to choose (default {FEW}, up to {MANY} where causes are close)",
    )
    parser.add_argument("-o", "--output", metavar="POSES.csv", help="the table")
    parser.add_argument("--json", metavar="OUT.json")
    add_pages(parser, "the table with a picture")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    check_readings(args.poses)
    outputs = {
        "-o": (args.output, POSES),
        "--json": (args.json, RESULT),
        **page_outputs(args),
    }
    check_outputs(outputs, [args.arm, args.calibration, *args.session], args.force)
    arm, calibration = load_given(args)
    with bar(aside(args), "reading") as told:
        chosen = design(
            arm, args.session, calibration=calibration, readings=args.poses, progress=told
        )
    rows = chosen.rows
    if args.output:
        text = io.StringIO()
        writer = csv.DictWriter(text, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
        write_whole(args.output, text.getvalue())
    if args.json:
        write_whole(args.json, json.dumps(chosen.to_dict(), indent=1) + "\n")
    write_pages(args, chosen.page)
    _print(chosen.experiment, rows, chosen.next_experiment)
    for session in chosen.sessions:
        for remark in session.remarks:
            plain_console().print(remark)
    return 0


def _print(experiment: Experiment, rows: list[dict[str, Any]], sentence: str) -> None:
    console = plain_console()
    criterion = experiment.criterion
    console.print(
        f"To {criterion.words}: {experiment.climate.words}, these poses on one new placement\n"
        f"{criterion.quantity}: {experiment.before:.2f} {criterion.unit} with these sessions, "
        f"{experiment.after:.2f} with the experiment too",
        soft_wrap=True,
    )
    shown = Table("pose", "tip, mm", "joints, °", "turn last towards", "°C")
    for row in rows:
        shown.add_row(
            str(row["pose"]),
            " ".join(f"{row[f'{a}_mm']:.0f}" for a in "xyz"),
            " ".join(f"{v:.0f}" for k, v in row.items() if k.endswith("_deg")),
            "".join(str(v) for k, v in row.items() if k.startswith("approach_joint")),
            " ".join(f"{v:.0f}" for k, v in row.items() if k.endswith("_c")),
        )
    console.print(shown)
    console.print(f"armd diagnose says: {sentence}", soft_wrap=True)

"""`armd design`: choose the poses to measure next, or first."""

from __future__ import annotations

import argparse
import csv
import io
import json
from typing import Any

from rich.table import Table

from armd.compensation.design.design import FEW, MANY, Experiment
from armd.compensation.report.layout.written import add_pages, list_page_outputs, write_pages
from armd.daemon.commands.offline import first_design
from armd.daemon.commands.offline.given import add_arm, add_model_under_test, load_given
from armd.errors import BadInput
from armd.files.outputs import POSES, RESULT, add_force, check_outputs
from armd.files.writing import write_whole
from armd.offline.design import DesignResult, check_readings, design
from armd.offline.first_design import FirstDesignResult
from armd.terminal.arguments import parse_finite
from armd.terminal.aside import make_aside, show_bar
from armd.terminal.plain import make_plain_console


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "session", nargs="*", help="sessions measured so far (none: poses for a first calibration)"
    )
    add_arm(parser)
    add_model_under_test(parser)
    parser.add_argument(
        "--readings",
        "--poses",
        type=int,
        metavar="N",
        help=f"how many to choose (default: with sessions {FEW}, up to {MANY} where causes are"
        " close; without, as many as a certificate wants)",
    )
    first = parser.add_argument_group("without sessions")
    first.add_argument(
        "--artefact",
        metavar="A.toml",
        help="its targets are measured, in three placements (default: a tracker's points)",
    )
    first.add_argument(
        "--reach",
        nargs=2,
        type=parse_finite,
        metavar=("MIN", "MAX"),
        help="distance of the tip from the base, mm",
    )
    first.add_argument(
        "--lowest",
        type=parse_finite,
        metavar="MM",
        help="no part of the arm lower than this over the base (default: no limit)",
    )
    parser.add_argument("-o", "--output", metavar="POSES.csv", help="the table")
    parser.add_argument("--json", metavar="OUT.json")
    add_pages(parser, "the table with a picture")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    if args.session:
        check_readings(args.readings)
    outputs = {
        "-o": (args.output, POSES),
        "--json": (args.json, RESULT),
        **list_page_outputs(args),
    }
    check_outputs(outputs, [args.arm, args.calibration, args.artefact, *args.session], args.force)
    chosen = _choose(args) if args.session else first_design.choose(args)
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
    if isinstance(chosen, FirstDesignResult):
        first_design.show(chosen)
        return 0
    _print(chosen.experiment, rows, chosen.next_experiment)
    for session in chosen.sessions:
        for remark in session.remarks:
            make_plain_console().print(remark)
    return 0


def _choose(args: argparse.Namespace) -> DesignResult:
    for option in ("artefact", "reach", "lowest"):
        if getattr(args, option) is not None:
            expected = "it without sessions: with them, their own artefact and ranges count"
            raise BadInput("command line", f"--{option}", "it beside sessions", expected)
    arm, calibration = load_given(args)
    sessions: list[str] = args.session
    with show_bar(make_aside(args), "reading") as report_progress:
        return design(
            arm, sessions, calibration=calibration, readings=args.readings, progress=report_progress
        )


def _print(experiment: Experiment, rows: list[dict[str, Any]], sentence: str) -> None:
    console = make_plain_console()
    criterion = experiment.criterion
    console.print(
        f"To {criterion.words}: {experiment.climate.words}, these poses on one new placement\n"
        f"{criterion.quantity}: {experiment.before:.2f} {criterion.unit} with these sessions, "
        f"{experiment.after:.2f} with the experiment too",
        soft_wrap=True,
    )
    table = Table("pose", "tip, mm", "joints, °", "turn last towards", "°C")
    for row in rows:
        table.add_row(
            str(row["pose"]),
            " ".join(f"{row[f'{a}_mm']:.0f}" for a in "xyz"),
            " ".join(f"{v:.0f}" for k, v in row.items() if k.endswith("_deg")),
            "".join(str(v) for k, v in row.items() if k.startswith("approach_joint")),
            " ".join(f"{v:.0f}" for k, v in row.items() if k.endswith("_c")),
        )
    console.print(table)
    console.print(f"armd diagnose says: {sentence}", soft_wrap=True)

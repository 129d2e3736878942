"""`armd design`: the poses to measure next, or first."""

from __future__ import annotations

import argparse
import csv
import io
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.table import Table

from armd.compensation.data.session import Session, load_sessions
from armd.compensation.design.conditions import POOL
from armd.compensation.design.design import FEW, MANY, Experiment, design
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.told.advice import next_experiment
from armd.compensation.model.arm import Arm
from armd.compensation.report.written import add_pages, page_outputs, write_pages
from armd.daemon.commands.offline import first_design
from armd.daemon.commands.offline.given import add_arm, add_model_under_test, load_given
from armd.errors import BadInput
from armd.files.outputs import POSES, RESULT, add_force, check_outputs
from armd.files.writing import write_whole
from armd.terminal.arguments import finite
from armd.terminal.aside import aside, bar
from armd.terminal.plain import plain_console


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
        type=finite,
        metavar=("MIN", "MAX"),
        help="distance of the tip from the base, mm",
    )
    first.add_argument(
        "--lowest",
        type=finite,
        metavar="MM",
        help="no part of the arm lower than this over the base (default: no limit)",
    )
    parser.add_argument("-o", "--output", metavar="POSES.csv", help="the table")
    parser.add_argument("--json", metavar="OUT.json")
    add_pages(parser, "the table with a picture")
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    if args.session and args.readings is not None and not 1 <= args.readings <= POOL:
        raise BadInput("--readings/--poses", "value", str(args.readings), f"1 to {POOL}")
    outputs = {
        "-o": (args.output, POSES),
        "--json": (args.json, RESULT),
        **page_outputs(args),
    }
    check_outputs(outputs, [args.arm, args.calibration, args.artefact, *args.session], args.force)
    if not args.session:
        return first_design.run(args)
    for option in ("artefact", "reach", "lowest"):
        if getattr(args, option) is not None:
            expected = "it without sessions: with them, their own artefact and ranges count"
            raise BadInput("command line", f"--{option}", "it beside sessions", expected)
    arm, loaded = load_given(args)
    calibration = loaded.content if loaded else None
    sessions = load_sessions(args.session, arm)
    with bar(aside(args), "reading") as told:
        diagnosis = diagnose(sessions, arm, calibration, progress=told)
        told("choosing poses", 1.0)
        experiment = design(diagnosis, args.readings)
    rows = table(experiment, arm.sensors)
    if args.output:
        text = io.StringIO()
        writer = csv.DictWriter(text, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
        write_whole(args.output, text.getvalue())
    if args.json:
        result = {
            "schema": "armd.design/1",
            "goal": experiment.criterion.words,
            "quantity": experiment.criterion.quantity,
            "unit": experiment.criterion.unit,
            "before": experiment.before,
            "after": experiment.after,
            "climate": experiment.climate.words,
            "next_experiment": next_experiment(diagnosis),
            "poses": rows,
        }
        write_whole(args.json, json.dumps(result, indent=1) + "\n")
    write_pages(args, lambda: _page(args, experiment, arm, sessions, rows))
    _print(experiment, rows, next_experiment(diagnosis))
    for session in sessions:
        for remark in session.remarks:
            plain_console().print(remark)
    return 0


def _page(
    args: argparse.Namespace,
    experiment: Experiment,
    arm: Arm,
    sessions: Sequence[Session],
    rows: list[dict[str, Any]],
) -> str:
    from armd.compensation.report.design import design_report  # drawings load slowly

    files = {"arm": args.arm, "calibration": args.calibration}
    return design_report(experiment, arm, sessions, rows, files)


def table(experiment: Experiment, sensors: list[str]) -> list[dict[str, Any]]:
    """One row per pose: where the tip goes, how the arm stands, from where, how warm."""
    states = experiment.states
    return [
        {
            "pose": i + 1,
            **{f"{a}_mm": round(float(v), 1) for a, v in zip("xyz", tip, strict=True)},
            **{f"q{k}_deg": round(float(v), 1) for k, v in enumerate(np.degrees(states.q[i]), 1)},
            **{
                f"approach_joint_{k}": "+" if v > 0 else "-"
                for k, v in enumerate(states.rate[i], 1)
            },
            **{
                f"{name}_c": round(float(v), 1)
                for name, v in zip(sensors, states.temperature_c[i], strict=True)
            },
        }
        for i, tip in enumerate(experiment.tip_mm)
    ]


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

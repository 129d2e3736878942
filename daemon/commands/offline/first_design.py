"""`armd design` without sessions: choose the poses of the first measurement."""

from __future__ import annotations

import argparse

from rich.table import Table

from armd.compensation.design.first import Bounds
from armd.daemon.commands.offline.given import load_given
from armd.errors import BadInput
from armd.offline.calibration import resolve_calibration
from armd.offline.first_design import FirstDesignResult, design_without_sessions
from armd.terminal.aside import make_aside
from armd.terminal.plain import make_plain_console


def choose(args: argparse.Namespace) -> FirstDesignResult:
    bounds = Bounds(_read_reach(args.reach), args.lowest)
    arm, calibration = load_given(args)
    loaded = resolve_calibration(calibration, arm)
    with make_aside(args).status("choosing poses …"):
        return design_without_sessions(arm, loaded, args.readings, args.artefact, bounds)


def show(chosen: FirstDesignResult) -> None:
    console = make_plain_console()
    for sentence in chosen.words:
        console.print(sentence, soft_wrap=True)
    places = ["placement", "target"] if chosen.experiment.placements else []
    table = Table("pose", *places, "tip, mm", "joints, °")
    for row in chosen.rows:
        table.add_row(
            str(row["pose"]),
            *(row[name] for name in places),
            " ".join(f"{row[f'{a}_mm']:.0f}" for a in "xyz"),
            " ".join(f"{v:.0f}" for k, v in row.items() if k.endswith("_deg")),
        )
    console.print(table)


def _read_reach(limits_mm: list[float] | None) -> tuple[float, float] | None:
    if limits_mm is None:
        return None
    lowest_mm, highest_mm = limits_mm
    if not 0.0 <= lowest_mm < highest_mm < float("inf"):
        problem = f"{lowest_mm:g} {highest_mm:g}"
        raise BadInput("--reach", "value", problem, "MIN MAX in mm, MIN at least 0 and below MAX")
    return lowest_mm, highest_mm

"""`armd interim` on tables of points, for an arm whose joints cannot be read."""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from armd.compensation.data.foreign.table import TABLES
from armd.compensation.interim.checks import chain, keeping
from armd.compensation.interim.points.figures import compute_figures
from armd.compensation.interim.points.history import keep_tables, load_checks, read_tables
from armd.compensation.interim.points.judge import PointEpoch, judge_points
from armd.compensation.interim.points.result import describe_points, format_points
from armd.compensation.report.layout.about import About
from armd.compensation.report.layout.written import write_pages
from armd.daemon.files.session_folder import load_artefact
from armd.errors import BadInput
from armd.files.writing import write_changed, write_whole
from armd.offline.corrector import parse_instant
from armd.printable import to_printable
from armd.terminal.aside import make_aside


def add_arguments(add: argparse.ArgumentParser) -> None:
    """Add the options that tables of points need."""
    points = add.add_argument_group("tables of points")
    points.add_argument("--artefact", type=Path, metavar="A.toml", help="what was touched")
    points.add_argument(
        "--tip-radius-mm", type=float, metavar="R",
        help="of the ball, where points on a sphere are its centre's (0: on the surface)",
    )  # fmt: skip
    points.add_argument("--started", metavar="ISO", help="when a table without dates was measured")


def are_tables(paths: Sequence[str]) -> bool:
    """Return whether checks are tables of points; raises `BadInput` for a mixture."""
    kinds = [Path(p).suffix.lower() in TABLES and not Path(p).is_dir() for p in paths]
    if any(kinds) and not all(kinds):
        session = paths[kinds.index(False)]
        expected = "tables of points alone, or session folders alone"
        raise BadInput("the command line", "SESSION", f"{session} beside tables", expected)
    return all(kinds)


def refuse_options(args: argparse.Namespace) -> None:
    """Raise `BadInput` for options that only tables have."""
    for option in ("artefact", "tip_radius_mm", "started"):
        if getattr(args, option) is not None:
            name = f"--{option.replace('_', '-')}"
            raise BadInput("the command line", name, "it with a session", "it with a table")


def add(args: argparse.Namespace) -> int:
    """Keep tables and judge the whole history."""
    for option in ("arm", "calibration"):
        if getattr(args, option) is not None:
            expected = "it with a session: a table has points, and no joint angles"
            raise BadInput("the command line", f"--{option}", "it with a table", expected)
    if args.artefact is None:
        expected = "the file of what was touched, with its table [artefact]"
        raise BadInput("the command line", "--artefact", "nothing", expected)
    folder, radius_mm = Path(args.history), args.tip_radius_mm or 0.0
    if not (0 <= radius_mm < 1e3):
        raise BadInput("the command line", "--tip-radius-mm", f"{radius_mm:g}", "0 to 1000")
    artefact = load_artefact(args.artefact, [])
    new = read_tables(args.session, _started(args.started))
    dated = [table.dated for table in new]
    now = math.floor(time.time())
    if not args.future:
        keeping.check_past(dated, now)
    for table in new:
        compute_figures(table.path, table.points, artefact, radius_mm)
    with keeping.lock_history(folder), make_aside(args).status("judging the history …"):
        lines = chain.read_lines(folder, chain.PointsLine).lines
        if not args.future:
            keeping.check_clock(folder, lines, now)
        try:
            keeping.check_new(folder, lines, dated)
        except BadInput as error:
            if not any(table.by_file and str(table.path) == error.file for table in new):
                raise
            expected = f"{error.expected}; it is dated by the file's last change: a column of dates"
            raise BadInput(
                error.file, error.where, error.found, f"{expected}, or --started"
            ) from error
        if lines:
            load_checks(folder)  # raises for a damaged history
        keep_tables(folder, len(lines), new, args.artefact, radius_mm)
        epochs, result = _judge_history(folder)
    remarks = [] if args.quiet else [sentence for table in new for sentence in table.remarks]
    for remark in filter(None, [*remarks, keeping.report_early_dates(lines, dated)]):
        make_aside(args).print(f"armd: {to_printable(remark)}", soft_wrap=True, markup=False)
    return _print_result(epochs, result, print_json=args.json)


def _started(text: str | None) -> float | None:
    return None if text is None else parse_instant("--started", text, "the command line")


def report(args: argparse.Namespace, to_file: str | None, about: About) -> int:
    """Report on a history of tables; *to_file* also gets the JSON result."""
    if args.poses:
        raise BadInput("--poses", "the history", "one of points", "one of sessions, with joints")
    folder = Path(args.history)
    with make_aside(args).status("judging the history …"):
        epochs, result = _judge_history(folder)
    write_pages(args, lambda: _render_page(folder, epochs, result, about))
    if to_file:
        write_whole(to_file, json.dumps(result, indent=1, allow_nan=False) + "\n")
    return _print_result(epochs, result, print_json=args.json == "-")


def _render_page(
    folder: Path, epochs: Sequence[PointEpoch], result: dict[str, Any], about: About
) -> str:
    from armd.compensation.interim.points.page import render_points_page  # slow to load

    return render_points_page(folder, epochs, result, about)


def _judge_history(folder: Path) -> tuple[list[PointEpoch], dict[str, Any]]:
    epochs = judge_points(load_checks(folder))
    result = format_points(epochs)
    write_changed(folder / chain.REPORT, json.dumps(result, indent=1, allow_nan=False) + "\n")
    return epochs, result


def _print_result(epochs: Sequence[PointEpoch], result: dict[str, Any], *, print_json: bool) -> int:
    if print_json:
        print(json.dumps(result, indent=1, allow_nan=False))
    else:
        for line in describe_points(epochs):
            print(line)
        print(f"next: {result['next_check']['sentence']}")
    return 1 if result["state"] == "changed" else 0

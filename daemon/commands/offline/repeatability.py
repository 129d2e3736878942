"""`armd feature repeatability`: evaluate one seat visited many times.

The visits are a session or a table of points.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from armd.arrays import F64, Mask
from armd.compensation.data.foreign.points import read_points
from armd.compensation.data.foreign.table import TABLES
from armd.compensation.data.sessions.session import Session, load_session
from armd.compensation.report.layout.written import list_page_outputs, write_pages
from armd.compensation.verify import single
from armd.compensation.verify.figures import correct_positions
from armd.compensation.verify.repeatability import (
    Repeatability,
    describe_repeatability,
    fit_repeatability,
)
from armd.daemon.commands.offline.given import load_given
from armd.errors import BadInput
from armd.files.outputs import RESULT, check_outputs
from armd.files.writing import write_whole
from armd.terminal.plain import make_plain_console
from armd.terminal.suggest import format_names


class Visits(NamedTuple):
    """The measured visits, and remarks from reading them."""

    position_mm: F64  # (n, 3)
    time_h: F64  # (n,) NaN unknown
    temperature_c: F64  # (n,) NaN unknown
    sensors: Sequence[str]
    remarks: Sequence[str]


def run(args: argparse.Namespace) -> int:
    """Evaluate the visits of one seat; always returns 0.

    Raises `BadInput`, also for more than one target or placement.
    """
    if len(args.operand) != 1:
        count = f"{len(args.operand)} operands"
        raise BadInput("the command line", "armd feature repeatability", count, "1")
    path = Path(args.operand[0])
    outputs = {"--json": (args.json, RESULT), **list_page_outputs(args)}
    check_outputs(outputs, [path, args.arm, args.calibration], args.force)
    of_table = path.suffix.lower() in TABLES and not path.is_dir()
    visits = _load_table(args, path) if of_table else _load_session(args, path)
    try:
        repeatability = fit_repeatability(visits.position_mm, visits.time_h, visits.temperature_c)
    except ArithmeticError as error:
        raise BadInput(path, "the visits", str(error), "more visits of the seat") from error
    words = [*describe_repeatability(repeatability, visits.sensors), *visits.remarks]
    if args.json:
        result = repeatability.as_json() | {"sensors": list(visits.sensors)}
        write_whole(args.json, json.dumps(result, indent=1, allow_nan=False) + "\n")
    write_pages(args, lambda: _render_page(args, repeatability, words, visits, path))
    console = make_plain_console()
    for line in words:
        console.print(line, soft_wrap=True)
    return 0


def _load_table(args: argparse.Namespace, path: Path) -> Visits:
    for option in ("arm", "calibration"):
        if getattr(args, option) is not None:
            expected = "it with a session: a table has points, and no joint angles"
            raise BadInput("the command line", f"--{option}", "it with a table", expected)
    points = read_points(path, timed=True)
    _require_one(path, list(zip(points.placement, points.target, strict=True)))
    unknown = np.full(len(points.target), np.nan)
    remarks = [f"remark: {sentence}" for sentence in points.remarks]
    return Visits(points.position_mm, np.array(points.time_s) / 3600, unknown, (), remarks)


def _load_session(args: argparse.Namespace, path: Path) -> Visits:
    if args.arm is None:
        raise BadInput("the command line", "--arm", "nothing", "the arm.toml measured with")
    arm, calibration = load_given(args)
    session = load_session(path, arm.content)
    names = session.artefact.target_names
    _require_one(
        path,
        [
            (session.placement_names[p], names[t])
            for p, t in zip(session.placement, session.target, strict=True)
        ],
    )
    loaded = None if calibration is None else calibration.for_arm(arm.content)
    position = correct_positions(session, arm.content, loaded)
    usable = np.isfinite(position[:, 0])  # all three coordinates are known, or none
    remarks = [
        f"remark: {line}" for line in single.check_repeats(session, position).in_words(session)
    ]
    if not usable.all():
        remarks.append(f"remark: {int((~usable).sum())} visits without a temperature do not count")
    time_h = (session.states.time_s - session.started_unix_s) / 3600
    temperature, sensors = _average_temperature(session, arm.content.sensors, usable)
    return Visits(position[usable], time_h[usable], temperature[usable], sensors, remarks)


def _average_temperature(
    session: Session, names: Sequence[str], usable: Mask
) -> tuple[F64, list[str]]:
    """Return the mean of the sensors that every visit has, and their names.

    Without such a sensor it is the artefact's temperature.
    """
    every = session.states.temperature_c
    complete = [i for i in range(every.shape[1]) if np.isfinite(every[usable, i]).all()]
    if complete:
        return every[:, complete].mean(axis=1), [names[i] for i in complete]
    return session.artefact_c, ["artefact_c"] if np.isfinite(session.artefact_c).all() else []


def _require_one(path: Path, places: Sequence[tuple[str, str]]) -> None:
    """Raise `BadInput` unless all visits are of one target in one placement."""
    different = list(dict.fromkeys(places))
    if len(different) > 1:
        problem = format_names([f"{target} in {placement}" for placement, target in different])
        raise BadInput(path, "target", problem, "one seat in one placement, visited many times")


def _render_page(
    args: argparse.Namespace,
    repeatability: Repeatability,
    words: Sequence[str],
    visits: Visits,
    path: Path,
) -> str:
    from armd.compensation.report.repeatability import (
        make_repeatability_page,  # slow to load
    )
    from armd.compensation.report.sessions import InputFile

    readings = next(
        (file for file in (path / "readings.csv", path / "readings.parquet") if file.exists()), path
    )
    files = {
        "readings": InputFile.read(readings),
        "arm": InputFile.read(args.arm),
        "calibration": InputFile.read(args.calibration),
    }
    conditions = visits.time_h, visits.temperature_c
    return make_repeatability_page(repeatability, words, conditions, path.resolve().name, files)

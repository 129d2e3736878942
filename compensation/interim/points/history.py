"""A history whose checks are tables of points; it is kept like one of sessions, with the artefacts.

checks/STARTED-NAME/     the table as it was written
artefacts/               the artefacts' files, by their hash
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from armd.compensation.data.foreign.points import PointTable, read_points
from armd.compensation.data.sessions.format import ArtefactFile
from armd.compensation.interim.checks.appending import (
    CHECKS,
    NewLine,
    add_checks,
    make_folder_name,
)
from armd.compensation.interim.checks.chain import PointsLine, read_lines
from armd.compensation.interim.checks.history import check_hash, format_iso
from armd.compensation.interim.checks.keeping import ARTEFACTS, CheckDate
from armd.compensation.interim.points.figures import ARM, PointCheck, compute_figures
from armd.compensation.wording import format_clock
from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.files.schema import load_toml


@dataclass(frozen=True)
class NewTable:
    """A table that was read, with the dates of its measurement."""

    path: Path
    points: PointTable
    dated: CheckDate
    remarks: list[str]
    by_file: bool  # whether it is dated by the file's last change


def read_tables(paths: Sequence[str], started_unix_s: float | None) -> list[NewTable]:
    """Read the tables of checks; *started_unix_s* is the instant of the first point of a single
    table.

    Without it the instant is the table's first date, or else the file's last change. Raises
    `BadInput`.
    """
    if started_unix_s is not None and len(paths) > 1:
        expected = "one table with --started, or a column of dates in each"
        raise BadInput("the command line", "--started", f"it with {len(paths)} tables", expected)
    return [_read(Path(path), started_unix_s) for path in paths]


def _read(path: Path, started_unix_s: float | None) -> NewTable:
    points = read_points(path, timed=True)
    remarks = [f"{path.name}: {sentence}" for sentence in points.remarks]
    finite_s = [second for second in points.time_s if math.isfinite(second)]
    first_s = started_unix_s
    if first_s is None and points.started is not None:
        first_s = points.started.timestamp() + min(finite_s, default=0.0)
    by_file = first_s is None
    if first_s is None:
        first_s = float(int(path.stat().st_mtime))
        remarks.append(
            f"{path.name}: measured when the file was last changed, {format_clock(first_s)}"
            " (--started, or a column of dates)"
        )
    last_s = first_s + (max(finite_s) - min(finite_s) if finite_s else 0.0)
    return NewTable(
        path, points, CheckDate(path.stem, path, ARM, first_s, first_s, last_s), remarks, by_file
    )


def keep_tables(
    folder: Path, count: int, new: Sequence[NewTable], artefact: Path, tip_radius_mm: float
) -> None:
    """Append checks to the *count* checks in *folder*; the caller has locked the history."""
    data = read_input(artefact)
    sha256 = hashlib.sha256(data).hexdigest()
    new_lines = []
    for table in new:
        facts = {
            "schema": "armd.interim.points/1",
            "name": table.dated.name,
            "started": format_iso(table.dated.started_unix_s),
            "arm": ARM,
            "first_unix_s": table.dated.first_unix_s,
            "last_unix_s": table.dated.last_unix_s,
            "artefact": sha256,
            "tip_radius_mm": tip_radius_mm,
        }
        contents = {f"points{table.path.suffix.lower()}": read_input(table.path)}
        new_lines.append(
            NewLine(facts, make_folder_name(str(facts["started"]), table.dated.name), contents)
        )
    add_checks(folder, count, new_lines, {Path(ARTEFACTS) / f"{sha256}.toml": data})


def load_checks(folder: Path) -> list[PointCheck]:
    """Load all checks in order of time; raises `BadInput` where the history is damaged."""
    lines = read_lines(folder, PointsLine).lines
    if not lines:
        raise BadInput(folder, "the history", "no checks", "some: armd interim add keeps them")
    checks = []
    for line in sorted(lines, key=lambda line: line.first_unix_s):
        path = folder / ARTEFACTS / f"{line.artefact}.toml"
        check_hash(path, line.artefact)
        for name, sha256 in line.files.items():
            check_hash(folder / CHECKS / line.folder / name, sha256)
        (name,) = line.files
        table = folder / CHECKS / line.folder / name
        artefact = load_toml(path, ArtefactFile).artefact
        figures = compute_figures(table, read_points(table), artefact, line.tip_radius_mm)
        checks.append(
            PointCheck(
                line.name,
                line.first_unix_s,
                line.last_unix_s,
                line.artefact,
                line.tip_radius_mm,
                tuple(figures),
                line.files,
            )
        )
    return checks

"""The folder of an append-only history of checks, each line with the hash of the one before.

    history.jsonl            one line per check, in the order of adding
    head.json                the number of lines, and the last one's hash
    checks/STARTED-NAME/     the session as it was measured, and statistics.json, its reduction
    arms/, calibrations/     the files that the checks were added with, by their hash

A check's folder is complete before its line is written, and every file appears whole or not at all.
So a power cut leaves the history either as it was before or as it is after.
"""

from __future__ import annotations

import datetime
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from armd.compensation.data.sessions.session import Session, load_session
from armd.compensation.interim.checks.catalogue_digest import hash_catalogue
from armd.compensation.interim.checks.chain import HistoryLine, read_chain
from armd.compensation.interim.checks.columns import Cause, list_causes
from armd.compensation.interim.checks.open_growth import list_open_growth
from armd.compensation.interim.checks.reduce import reduce
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.checks.statistics import from_json
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import LoadedCalibration, load_calibration
from armd.errors import BadInput
from armd.files.inputs import read_input

STATISTICS = "statistics.json"


@dataclass(frozen=True)
class Check:
    """A check of the history."""

    line: HistoryLine
    arm: Arm
    calibration: LoadedCalibration
    reduced: Reduced

    @property
    def epoch(self) -> tuple[str, str]:
        """The calibration and the description of the arm; checks that share both are judged
        together.
        """
        return self.calibration.sha256, self.arm.model_dump_json()


def load(folder: Path, before: Sequence[Check] = ()) -> list[Check]:
    """Load all checks of a history in order of time; raises `BadInput` where it is damaged.

    Checks that were loaded *before* are compared with their hashes and not read again.
    """
    lines = read_chain(folder).lines
    if not lines:
        raise BadInput(folder, "the history", "no checks", "some: armd interim add keeps them")
    arms: dict[str, Arm] = {}
    calibrations: dict[str, LoadedCalibration] = {}
    catalogues: dict[tuple[str, str], tuple[list[Cause], str]] = {}
    checks = []
    loaded = {check.line.check: check for check in before}
    for line in lines:
        if line.arm_file not in arms:
            path = folder / "arms" / f"{line.arm_file}.toml"
            check_hash(path, line.arm_file)
            arms[line.arm_file] = load_arm(path)
        arm = arms[line.arm_file]
        if line.calibration not in calibrations:
            path = folder / "calibrations" / f"{line.calibration}.json"
            check_hash(path, line.calibration)
            calibrations[line.calibration] = load_calibration(path, arm)
        place = folder / "checks" / line.folder
        for name, sha256 in line.files.items():
            check_hash(place / name, sha256)
        calibration = calibrations[line.calibration]
        epoch = line.arm_file, line.calibration
        if epoch not in catalogues:
            causes = list_causes(arm, calibration.content)
            growth = list_open_growth(arm, calibration.content)
            catalogues[epoch] = causes, hash_catalogue(causes, growth)
        causes, catalogue = catalogues[epoch]
        if (same := loaded.get(line.check)) is not None and same.line == line:
            checks.append(same)
            continue
        path = place / STATISTICS
        check = Check(line, arm, calibration, from_json(path, read_input(path)))
        if check.reduced.catalogue != catalogue:
            check = _reduce_as_today(folder, check, causes)
        checks.append(check)
    return sorted(checks, key=lambda check: check.line.first_unix_s)


def load_measured(folder: Path, check: Check) -> Session:
    """Load a check's session as it was measured, under the name by which it was added."""
    measured = load_session(folder / "checks" / check.line.folder, check.arm)
    return replace(measured, name=check.line.name)


def _reduce_as_today(folder: Path, check: Check, causes: Sequence[Cause]) -> Check:
    """Reduce a check again from its readings, because its statistics are of another catalogue."""
    measured = load_measured(folder, check)
    return replace(check, reduced=reduce(measured, check.arm, check.calibration.content, causes))


def check_hash(path: Path, sha256: str) -> None:
    """Raise `BadInput` unless *path* has content of this hash."""
    if not path.is_file():
        raise BadInput(path, "the file", "nothing", "the file that the history was written with")
    if hashlib.sha256(read_input(path)).hexdigest() != sha256:
        mismatch = "content that does not match its hash (edited or damaged)"
        raise BadInput(path, "the file", mismatch, f"the file as it was kept, {sha256[:16]}…")


def format_iso(unix_s: float) -> str:
    """Format an instant as the contract does: UTC, to the second, with microseconds if there are
    any.
    """
    moment = datetime.datetime.fromtimestamp(unix_s, datetime.UTC)
    return moment.isoformat(timespec="microseconds" if moment.microsecond else "seconds").replace(
        "+00:00", "Z"
    )

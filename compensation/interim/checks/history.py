"""The folder in which checks are kept: append-only, each line holding the hash of the one before.

    history.jsonl            one line per check, in the order of adding
    head.json                how many lines there are, and the last one's hash
    checks/STARTED-NAME/     the session as it was measured, and statistics.json, what it says
    arms/, calibrations/     the files that the checks were added with, by their hash

A check's folder is whole before its line is written, and every file appears whole or not at all:
what a power cut leaves is the history of before, or of after.
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
    """A check that the history has."""

    line: HistoryLine
    arm: Arm
    calibration: LoadedCalibration
    reduced: Reduced

    @property
    def epoch(self) -> tuple[str, str]:
        """Checks under one calibration and one description of the arm are judged together."""
        return self.calibration.sha256, self.arm.model_dump_json()


def load(folder: Path, before: Sequence[Check] = ()) -> list[Check]:
    """All checks of a history in order of time; raises `BadInput` where it is damaged. Those that
    were loaded *before* are held to their hashes and not read again."""
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
    """A check as it was measured, under the name that it was added by."""
    measured = load_session(folder / "checks" / check.line.folder, check.arm)
    return replace(measured, name=check.line.name)


def _reduce_as_today(folder: Path, check: Check, causes: Sequence[Cause]) -> Check:
    """A check whose statistics are of another catalogue, from what was measured."""
    measured = load_measured(folder, check)
    return replace(check, reduced=reduce(measured, check.arm, check.calibration.content, causes))


def check_hash(path: Path, sha256: str) -> None:
    """Raise `BadInput` unless *path* has the content of that hash."""
    if not path.is_file():
        raise BadInput(path, "the file", "nothing", "the file that the history was written with")
    if hashlib.sha256(read_input(path)).hexdigest() != sha256:
        mismatch = "content that does not match its hash (edited or damaged)"
        raise BadInput(path, "the file", mismatch, f"the file as it was kept, {sha256[:16]}…")


def format_iso(unix_s: float) -> str:
    """An instant as the contract has it: UTC, to the second, or finer where it is."""
    moment = datetime.datetime.fromtimestamp(unix_s, datetime.UTC)
    return moment.isoformat(timespec="microseconds" if moment.microsecond else "seconds").replace(
        "+00:00", "Z"
    )

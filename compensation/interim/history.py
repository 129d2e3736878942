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
import fcntl
import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field

from armd.compensation.data.session import READINGS, Session
from armd.compensation.interim.reduce import Reduced
from armd.compensation.interim.statistics import from_json, to_json
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import LoadedCalibration, load_calibration
from armd.errors import BadInput
from armd.files import told, write_whole
from armd.inputs import read_input
from armd.schema import Strict, json_data, validate

HISTORY, HEAD = "history.jsonl", "head.json"
STATISTICS = "statistics.json"
BEGINNING = "0" * 64


class Line(Strict):
    """One check, as the history has it."""

    schema_: str = Field(alias="schema", pattern="^armd.interim.check/1$")
    check: int
    name: str
    started: str
    arm: str
    first_unix_s: float
    last_unix_s: float
    folder: str
    files: dict[str, str]  # name → SHA-256
    arm_file: str  # SHA-256
    calibration: str  # SHA-256
    added: str
    previous: str


@dataclass(frozen=True)
class Check:
    """A check that the history has."""

    line: Line
    arm: Arm
    calibration: LoadedCalibration
    reduced: Reduced

    @property
    def epoch(self) -> tuple[str, str]:
        """Checks under one calibration and one description of the arm are judged together."""
        return self.calibration.sha256, self.arm.model_dump_json()


@dataclass(frozen=True)
class New:
    """A check to be kept."""

    session: Session
    reduced: Reduced


def load(folder: Path) -> list[Check]:
    """All checks of a history in order of time; raises `BadInput` where it is damaged."""
    lines = read_lines(folder)
    if not lines:
        raise BadInput(folder, "the history", "no checks", "some: armd interim add keeps them")
    arms: dict[str, Arm] = {}
    calibrations: dict[str, LoadedCalibration] = {}
    checks = []
    for line in lines:
        if line.arm_file not in arms:
            path = folder / "arms" / f"{line.arm_file}.toml"
            _check_hash(path, line.arm_file)
            arms[line.arm_file] = load_arm(path)
        arm = arms[line.arm_file]
        if line.calibration not in calibrations:
            path = folder / "calibrations" / f"{line.calibration}.json"
            _check_hash(path, line.calibration)
            calibrations[line.calibration] = load_calibration(path, arm)
        place = folder / "checks" / line.folder
        for name, sha256 in line.files.items():
            _check_hash(place / name, sha256)
        checks.append(
            Check(line, arm, calibrations[line.calibration], _statistics(place / STATISTICS))
        )
    return sorted(checks, key=lambda check: check.line.first_unix_s)


def read_lines(folder: Path) -> list[Line]:
    """The history's lines in the order of adding, their chain checked; none without a history."""
    path = folder / HISTORY
    if not path.exists():
        if (folder / HEAD).exists():
            raise BadInput(path, "the file", "nothing", f"the history that {HEAD} is of")
        return []
    data = read_input(path)
    raw = data.split(b"\n")
    if raw.pop() != b"":
        raise BadInput(path, f"line {len(raw) + 1}", "its end torn off", "a whole line")
    lines, previous = [], BEGINNING
    for number, text in enumerate(raw, 1):
        where = f"{path}: line {number}"
        line = validate(where, json_data(where, text), Line)
        if line.previous != previous or line.check != number:
            found = "a line that does not follow the one before (edited, or lines are missing)"
            raise BadInput(path, f"line {number}", found, f"the hash {previous[:16]}… of that line")
        previous = hashlib.sha256(text).hexdigest()
        lines.append(line)
    _check_head(folder, len(lines), [hashlib.sha256(text).hexdigest() for text in raw])
    return lines


def _check_head(folder: Path, count: int, hashes: Sequence[str]) -> None:
    """The head may be behind, after a power cut between two files, and never ahead."""
    path = folder / HEAD
    if not path.exists():
        raise BadInput(path, "the file", "nothing", f"the number of lines of {HISTORY}")
    head = validate(path, json_data(path, read_input(path)), Head)
    if head.checks > count:
        raise BadInput(
            folder / HISTORY, "the file", f"{count} checks", f"{head.checks}, as {HEAD} has them"
        )
    if (hashes[head.checks - 1] if head.checks else BEGINNING) != head.sha256:
        found = f"a line {head.checks} of another hash than {HEAD} has"
        raise BadInput(folder / HISTORY, f"line {head.checks}", found, "the line that was written")


class Head(Strict):
    """How long the history is."""

    schema_: str = Field(alias="schema", pattern="^armd.interim.head/1$")
    checks: int = Field(ge=0)
    sha256: str


def _check_hash(path: Path, sha256: str) -> None:
    if not path.is_file():
        raise BadInput(path, "the file", "nothing", "the file that the history was written with")
    if hashlib.sha256(read_input(path)).hexdigest() != sha256:
        found = "content that does not match its hash (edited or damaged)"
        raise BadInput(path, "the file", found, f"the file as it was kept, {sha256[:16]}…")


def _statistics(path: Path) -> Reduced:
    return from_json(path, json_data(path, read_input(path)))


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """One writer at a time; the folder is made if it is not there."""
    with told(folder):
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def check_new(folder: Path, lines: Sequence[Line], sessions: Sequence[Session]) -> None:
    """Raise `BadInput` for a check that is there, of another arm, or measured while another was."""
    spans = [(line.first_unix_s, line.last_unix_s, line.name) for line in lines]
    started = {line.started: line.name for line in lines}
    for session in sessions:
        other = next((line.arm for line in lines if line.arm != session.arm), None)
        if other is not None:
            raise BadInput(session.path, "arm", repr(session.arm), f"{other!r}, as in {folder}")
        at = iso(session.started_unix_s)
        if at in started:
            found = f"{at}, when check {started[at]} was started"
            raise BadInput(session.path / "session.toml", "started", found, "a check of its own")
        begun, ended = float(session.states.time_s.min()), float(session.states.time_s.max())
        for first, last, name in spans:
            if begun <= last and first <= ended:
                found = (
                    f"readings from {iso(begun)} to {iso(ended)}, while check {name} was measured "
                    f"({iso(first)} to {iso(last)})"
                )
                expected = "one check at a time: was a clock set back?"
                raise BadInput(session.path / "session.toml", "started", found, expected)
        started[at] = session.name
        spans.append((begun, ended, session.name))


def keep(
    folder: Path,
    lines: Sequence[Line],
    new: Sequence[New],
    arm_file: Path,
    calibration: LoadedCalibration,
) -> None:
    """Keep checks, whole and reduced; the history is `locked`, and they are `check_new`."""
    arm_data = read_input(arm_file)
    arm_sha = hashlib.sha256(arm_data).hexdigest()
    for name in ("arms", "calibrations", "checks"):
        (folder / name).mkdir(exist_ok=True)
    _keep_file(folder / "arms" / f"{arm_sha}.toml", arm_data)
    _keep_file(folder / "calibrations" / f"{calibration.sha256}.json", calibration.data)
    path = folder / HISTORY
    text = read_input(path) if path.exists() else b""
    previous = _hash_of_last(text)
    added = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
    for number, one in enumerate(new, len(lines) + 1):
        session, at = one.session, iso(one.session.started_unix_s)
        place = f"{at.replace(':', '').replace('-', '')}-{_plain(session.name)}"
        files = _keep_check(folder / "checks" / place, one)
        line: dict[str, Any] = {
            "schema": "armd.interim.check/1",
            "check": number,
            "name": session.name,
            "started": at,
            "arm": session.arm,
            "first_unix_s": float(session.states.time_s.min()),
            "last_unix_s": float(session.states.time_s.max()),
            "folder": place,
            "files": files,
            "arm_file": arm_sha,
            "calibration": calibration.sha256,
            "added": added,
            "previous": previous,
        }
        data = json.dumps(line, ensure_ascii=False).encode()
        previous = hashlib.sha256(data).hexdigest()
        text += data + b"\n"
    # A head of nothing before the first line, so that a history never stands without one.
    if not (folder / HEAD).exists():
        _write_head(folder, 0, BEGINNING)
    write_whole(path, text)
    _write_head(folder, len(lines) + len(new), previous)


def _write_head(folder: Path, checks: int, sha256: str) -> None:
    head = {"schema": "armd.interim.head/1", "checks": checks, "sha256": sha256}
    write_whole(folder / HEAD, json.dumps(head) + "\n")


def _hash_of_last(text: bytes) -> str:
    lines = text.split(b"\n")[:-1]
    return hashlib.sha256(lines[-1]).hexdigest() if lines else BEGINNING


def _keep_file(path: Path, data: bytes) -> None:
    if not path.exists() or path.read_bytes() != data:
        write_whole(path, data)


def _keep_check(place: Path, new: New) -> dict[str, str]:
    """The session's files and its statistics in *place*; their hashes."""
    if place.exists():  # begun and not finished: no line tells of it
        shutil.rmtree(place)
    part = place.with_name(f".{place.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir()
    contents = {
        name: read_input(new.session.path / name)
        for name in ("session.toml", *READINGS)
        if (new.session.path / name).exists()
    }
    contents[STATISTICS] = to_json(new.reduced).encode()
    for name, data in contents.items():
        write_whole(part / name, data)
    part.rename(place)
    handle = os.open(place.parent, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
    return {name: hashlib.sha256(data).hexdigest() for name, data in contents.items()}


def _plain(name: str) -> str:
    """A session's name as a part of a folder's."""
    kept = "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
    return kept[:80]


def iso(unix_s: float) -> str:
    """An instant as the contract has it: UTC, to the second, or finer where it is."""
    moment = datetime.datetime.fromtimestamp(unix_s, datetime.UTC)
    return moment.isoformat(timespec="microseconds" if moment.microsecond else "seconds").replace(
        "+00:00", "Z"
    )

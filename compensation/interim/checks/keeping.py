"""Checks put into the history: whole beside it first, then a line, then the head."""

from __future__ import annotations

import datetime
import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armd.compensation.data.session import Session
from armd.compensation.data.session_files import READINGS
from armd.compensation.interim.checks.chain import BEGINNING, HEAD, HISTORY, HistoryLine
from armd.compensation.interim.checks.history import STATISTICS, iso
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.checks.statistics import to_json
from armd.compensation.model.calibration import LoadedCalibration
from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.files.locking import lock_file
from armd.files.writing import check_folder, sync_folder, told, write_changed, write_whole
from armd.terminal.counted import counted

FOLDERS = ("arms", "calibrations", "checks")
#: Two computers' clocks may be so far apart, s.
CLOCKS_APART_S = 600.0


@dataclass(frozen=True)
class New:
    """A check to be kept."""

    session: Session
    reduced: Reduced


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """One writer at a time; the folder is made if it is not there. Raises `BadInput` unless a
    check can be kept in it."""
    with told(folder):
        if not folder.exists():
            folder.mkdir(parents=True, exist_ok=True)
        for place in (folder, *(folder / name for name in FOLDERS if (folder / name).exists())):
            check_folder(place)
        if os.name == "nt":  # which opens no folder
            yield
            return
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        lock_file(handle, wait=True)
        yield
    finally:
        os.close(handle)


def check_past(sessions: Sequence[Session], now_unix_s: float) -> None:
    """Raise `BadInput` for a check that is dated after now. A history gives nothing back: such a
    check would stay the latest, and every check until its date would be taken for one before it."""
    for session in sessions:
        ended = float(session.states.time_s.max())
        if ended > now_unix_s + CLOCKS_APART_S:
            found = f"readings until {iso(ended)}; this computer's clock says {iso(now_unix_s)}"
            expected = (
                "a check that has been made: set the clock that is wrong, or take it as it is "
                "with --future"
            )
            raise BadInput(session.path / "session.toml", "started", found, expected)


def check_clock(folder: Path, lines: Sequence[HistoryLine], now_unix_s: float) -> None:
    """Raise `BadInput` if this computer's clock says less than when it added the last check: it was
    set back, and what it dates now would be taken for measured before checks that came first."""
    if not lines:
        return
    added = datetime.datetime.fromisoformat(lines[-1].added).timestamp()
    if now_unix_s < added - CLOCKS_APART_S:
        found = (
            f"check {lines[-1].name} added at {lines[-1].added}; this computer's clock says "
            f"{iso(now_unix_s)}"
        )
        expected = (
            "a clock that was not set back: set it right, or, if it is right now, take the check "
            "as it is dated with --future"
        )
        raise BadInput(folder / HISTORY, f"line {len(lines)}, added", found, expected)


def dated_before(lines: Sequence[HistoryLine], sessions: Sequence[Session]) -> str:
    """What a person should know of *sessions* added after a check that was measured after them:
    that is as good as any other order, unless a clock was set back in between. "" if there are
    none."""
    latest = max(lines, key=lambda line: line.last_unix_s, default=None)
    if latest is None:
        return ""
    early = [s for s in sessions if float(s.states.time_s.max()) < latest.first_unix_s]
    if not early:
        return ""
    first = early[0]
    which = f"{first.name} ({iso(first.started_unix_s)})"
    if others := len(early) - 1:
        which += f" and {counted(others, 'other check')}"
    are, they = ("are", "They are") if others else ("is", "It is")
    return (
        f"{which} {are} dated before the last check of the history, {latest.name} "
        f"({latest.started}). {they} judged by date. If measured after that check, a clock was "
        "set back, and a change will be dated wrongly."
    )


def check_new(folder: Path, lines: Sequence[HistoryLine], sessions: Sequence[Session]) -> None:
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
    lines: Sequence[HistoryLine],
    new: Sequence[New],
    arm_file: Path,
    calibration: LoadedCalibration,
) -> None:
    """Keep checks, whole and reduced; the history is `locked`, and they are `check_new`."""
    arm_data = read_input(arm_file)
    arm_sha = hashlib.sha256(arm_data).hexdigest()
    path = folder / HISTORY
    places = [folder / "checks" / _folder_name(one.session) for one in new]
    with told(folder), _taken_back_unless_told_of(places, path):
        for name in FOLDERS:
            (folder / name).mkdir(exist_ok=True)
        write_changed(folder / "arms" / f"{arm_sha}.toml", arm_data)
        write_changed(folder / "calibrations" / f"{calibration.sha256}.json", calibration.data)
        text = read_input(path) if path.exists() else b""
        previous = _hash_of_last(text)
        added = datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
        for number, (one, place) in enumerate(zip(new, places, strict=True), len(lines) + 1):
            session = one.session
            line: dict[str, Any] = {
                "schema": "armd.interim.check/1",
                "check": number,
                "name": session.name,
                "started": iso(session.started_unix_s),
                "arm": session.arm,
                "first_unix_s": float(session.states.time_s.min()),
                "last_unix_s": float(session.states.time_s.max()),
                "folder": place.name,
                "files": _keep_check(place, one),
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


@contextmanager
def _taken_back_unless_told_of(places: Sequence[Path], history: Path) -> Iterator[None]:
    """What fails within this `with` (a full disk) leaves no check's folder, whole or in part, that
    no new line of *history* tells of: there it would keep the disk full."""
    before = history.read_bytes() if history.is_file() else b""
    try:
        yield
    except BaseException:
        with suppress(OSError):
            if (history.read_bytes() if history.is_file() else b"") == before:
                for place in places:
                    shutil.rmtree(_part_of(place), ignore_errors=True)
                    shutil.rmtree(place, ignore_errors=True)
        raise


def _write_head(folder: Path, checks: int, sha256: str) -> None:
    head = {"schema": "armd.interim.head/1", "checks": checks, "sha256": sha256}
    write_whole(folder / HEAD, json.dumps(head) + "\n")


def _hash_of_last(text: bytes) -> str:
    lines = text.split(b"\n")[:-1]
    return hashlib.sha256(lines[-1]).hexdigest() if lines else BEGINNING


def _keep_check(place: Path, new: New) -> dict[str, str]:
    """The session's files and its statistics in *place*; their hashes."""
    if place.exists():  # begun and not finished: no line tells of it
        shutil.rmtree(place)
    part = _part_of(place)
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
    sync_folder(place.parent)
    return {name: hashlib.sha256(data).hexdigest() for name, data in contents.items()}


def _part_of(place: Path) -> Path:
    """Where a check's folder is made before it stands in its *place*."""
    return place.with_name(f".{place.name}.part")


def _folder_name(session: Session) -> str:
    at = iso(session.started_unix_s)
    return f"{at.replace(':', '').replace('-', '')}-{_plain(session.name)}"


def _plain(name: str) -> str:
    """A session's name as a part of a folder's."""
    kept = "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
    return kept[:80]

"""Adds checks to the history: first their folders, then their lines, then the head."""

from __future__ import annotations

import datetime
import hashlib
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from armd.compensation.data.sessions.files import READINGS
from armd.compensation.data.sessions.session import Session
from armd.compensation.interim.checks.appending import (
    CHECKS,
    NewLine,
    add_checks,
    make_folder_name,
)
from armd.compensation.interim.checks.chain import HISTORY, AnyLine, HistoryLine
from armd.compensation.interim.checks.history import STATISTICS, format_iso
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.checks.statistics import to_json
from armd.compensation.model.calibration import LoadedCalibration
from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.files.locking import lock_file
from armd.files.writing import check_folder, explain_os_errors
from armd.terminal.counted import format_count

ARMS, CALIBRATIONS, ARTEFACTS = "arms", "calibrations", "artefacts"
FOLDERS = (ARMS, CALIBRATIONS, ARTEFACTS, CHECKS)
#: The largest difference that is accepted between two computers' clocks, s.
CLOCKS_APART_S = 600.0


@dataclass(frozen=True)
class NewCheck:
    """A check that is to be kept."""

    session: Session
    reduced: Reduced


@dataclass(frozen=True)
class CheckDate:
    """The dates of a check, and the file that states them."""

    name: str
    file: Path
    arm: str
    started_unix_s: float
    first_unix_s: float
    last_unix_s: float

    @classmethod
    def from_session(cls, session: Session) -> CheckDate:
        """Return the dates of a session."""
        time_s = session.states.time_s
        span = float(time_s.min()), float(time_s.max())
        file = session.path / "session.toml"
        return cls(session.name, file, session.arm, session.started_unix_s, *span)


@contextmanager
def lock_history(folder: Path) -> Iterator[None]:
    """Lock the history for one writer, and make its folder if it is missing.

    Raises `BadInput` unless a check can be kept in it.
    """
    with explain_os_errors(folder):
        if not folder.exists():
            folder.mkdir(parents=True, exist_ok=True)
        for place in (folder, *(folder / name for name in FOLDERS if (folder / name).exists())):
            check_folder(place)
        if os.name == "nt":  # Windows cannot open a folder
            yield
            return
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        lock_file(handle, wait=True)
        yield
    finally:
        os.close(handle)


def check_past(checks: Sequence[CheckDate], now_unix_s: float) -> None:
    """Raise `BadInput` for a check that is dated in the future.

    A history removes nothing: such a check would stay the latest, and every check until its date
    would be taken for an earlier one.
    """
    for check in checks:
        ended = check.last_unix_s
        if ended > now_unix_s + CLOCKS_APART_S:
            dates = (
                f"readings until {format_iso(ended)}; this computer's clock says "
                f"{format_iso(now_unix_s)}"
            )
            expected = (
                "a check that has been made: set the clock that is wrong, or take it as it is "
                "with --future"
            )
            raise BadInput(check.file, "started", dates, expected)


def check_clock(folder: Path, lines: Sequence[AnyLine], now_unix_s: float) -> None:
    """Raise `BadInput` if the clock is earlier than when this computer added the last check.

    Then the clock was set back, and a new check would be dated before checks that came first.
    """
    if not lines:
        return
    added = datetime.datetime.fromisoformat(lines[-1].added).timestamp()
    if now_unix_s < added - CLOCKS_APART_S:
        dates = (
            f"check {lines[-1].name} added at {lines[-1].added}; this computer's clock says "
            f"{format_iso(now_unix_s)}"
        )
        expected = (
            "a clock that was not set back: set it right, or, if it is right now, take the check "
            "as it is dated with --future"
        )
        raise BadInput(folder / HISTORY, f"line {len(lines)}, added", dates, expected)


def report_early_dates(lines: Sequence[AnyLine], checks: Sequence[CheckDate]) -> str:
    """Return a remark on *checks* that are dated before the last check of the history; "" if none
    are.

    Any order of adding is allowed, but a clock may have been set back in between.
    """
    latest = max(lines, key=lambda line: line.last_unix_s, default=None)
    if latest is None:
        return ""
    early = [check for check in checks if check.last_unix_s < latest.first_unix_s]
    if not early:
        return ""
    first = early[0]
    which = f"{first.name} ({format_iso(first.started_unix_s)})"
    if n_others := len(early) - 1:
        which += f" and {format_count(n_others, 'other check')}"
    are, they = ("are", "They are") if n_others else ("is", "It is")
    return (
        f"{which} {are} dated before the last check of the history, {latest.name} "
        f"({latest.started}). {they} judged by date. If measured after that check, a clock was "
        "set back, and a change will be dated wrongly."
    )


def check_new(folder: Path, lines: Sequence[AnyLine], checks: Sequence[CheckDate]) -> None:
    """Raise `BadInput` for a check that exists, is of another arm, or overlaps another check in
    time.
    """
    spans = [(line.first_unix_s, line.last_unix_s, line.name) for line in lines]
    started = {line.started: line.name for line in lines}
    for check in checks:
        arm_of_history = next((line.arm for line in lines if line.arm != check.arm), None)
        if arm_of_history is not None:
            raise BadInput(
                check.file, "arm", repr(check.arm), f"{arm_of_history!r}, as in {folder}"
            )
        instant = format_iso(check.started_unix_s)
        if instant in started:
            problem = f"{instant}, when check {started[instant]} was started"
            raise BadInput(check.file, "started", problem, "a check of its own")
        begun, ended = check.first_unix_s, check.last_unix_s
        for first, last, name in spans:
            if begun <= last and first <= ended:
                problem = (
                    f"readings from {format_iso(begun)} to {format_iso(ended)}, while check {name} "
                    f"was measured ({format_iso(first)} to {format_iso(last)})"
                )
                expected = "one check at a time: was a clock set back?"
                raise BadInput(check.file, "started", problem, expected)
        started[instant] = check.name
        spans.append((begun, ended, check.name))


def keep(
    folder: Path,
    lines: Sequence[HistoryLine],
    new: Sequence[NewCheck],
    arm_file: Path,
    calibration: LoadedCalibration,
) -> None:
    """Keep checks with their sessions and statistics.

    The caller has locked the history (`lock_history`), and the checks have passed `check_new`.
    """
    arm_data = read_input(arm_file)
    arm_sha = hashlib.sha256(arm_data).hexdigest()
    common = {
        Path(ARMS) / f"{arm_sha}.toml": arm_data,
        Path(CALIBRATIONS) / f"{calibration.sha256}.json": calibration.data,
    }
    new_lines = []
    for new_check in new:
        session = new_check.session
        started = format_iso(session.started_unix_s)
        facts = {
            "schema": "armd.interim.check/1",
            "name": session.name,
            "started": started,
            "arm": session.arm,
            "first_unix_s": float(session.states.time_s.min()),
            "last_unix_s": float(session.states.time_s.max()),
            "arm_file": arm_sha,
            "calibration": calibration.sha256,
        }
        new_lines.append(
            NewLine(facts, make_folder_name(started, session.name), _make_contents(new_check))
        )
    add_checks(folder, len(lines), new_lines, common)


def _make_contents(new: NewCheck) -> dict[str, bytes]:
    """Collect the session's files and its statistics."""
    contents = {
        name: read_input(new.session.path / name)
        for name in ("session.toml", *READINGS)
        if (new.session.path / name).exists()
    }
    return contents | {STATISTICS: to_json(new.reduced).encode()}

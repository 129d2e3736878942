"""Watch the history of interim checks of this arm, in a thread beside the stream.

`armd interim add` leaves its result in the history's folder. A thread reads it now and then,
because the folder may be on a sleeping disk or on another machine. The result describes the history
beside it: if that was edited or cut short, the result is invalid.
"""

from __future__ import annotations

import datetime
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armd.compensation.interim.checks.chain import (
    HEAD,
    HISTORY,
    REPORT,
    HistoryChain,
    HistoryLine,
    read_chain,
)
from armd.files.inputs import read_input
from armd.files.schema import load_json_data

#: Period in s after which the folder is read again.
LOOK_S = 5.0
HOUR_S = 3600.0
#: If a check is dated farther in the future, its clock or ours is wrong.
CLOCKS_APART_H = 1.0
#: Limit of a result's file; a history of ten years is a few megabytes.
MOST_BYTES = 1 << 26


@dataclass(frozen=True)
class LastCheck:
    """The result of the history; `fault` describes a fault of the history itself."""

    fault: str = ""
    name: str = ""
    started_unix_s: float = 0.0
    changed: str = ""  # since when and why; "" if the arm is in control
    judged: str = ""  # SHA-256 of the calibration that the checks are of
    changes: int = 0  # since that calibration
    checks: int = 0


class WatchedChain:
    """The lines of a history, of which none may change or disappear.

    A folder with a result and without a history (a copy) has nothing to watch.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._stamps: object = ()
        self._checked_chain = self._now = HistoryChain[HistoryLine]()

    def fault(self, checks: int) -> str:
        """Return a fault of the history, whose result has *checks* checks, or "".

        Raises `BadInput` where it is broken.
        """
        stamps = [_get_stamp(self._folder / name) for name in (HISTORY, HEAD)]
        if stamps != self._stamps:
            self._now = read_chain(self._folder)
            self._stamps = stamps
        path = self._folder / HISTORY
        now, hashes_before = self._now.hashes, self._checked_chain.hashes
        if now[: len(hashes_before)] != hashes_before:
            if len(now) < len(hashes_before):
                return f"{path} has {len(now)} checks, and had {len(hashes_before)}"
            return f"{path} has other checks than it had"
        self._checked_chain = self._now
        if (now or any(stamps)) and len(now) < checks:
            return f"{path} has {len(now)} checks, and {REPORT} is of {checks}"
        return ""


def _get_stamp(path: Path) -> tuple[int, int, int] | None:
    """Return values that change whenever a file changes; None without a file."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


class InterimChecks:
    """Reads the history; `last` is its latest result, None until it is read."""

    def __init__(self, folder: Path, serial_number: str) -> None:
        """Prepare to watch *folder*; its checks must be of the arm *serial_number*."""
        self.folder = folder
        self._serial_number = serial_number
        self.last: LastCheck | None = None
        self._last_read = LastCheck()  # from the result with `_stamp`
        self._stamp: tuple[int, int, int] | None = None
        self._chain = WatchedChain(folder)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="interim checks", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """Stop watching, without waiting for a disk."""
        self._ended.set()

    def _run(self) -> None:
        while True:
            self.look()
            if self._ended.wait(LOOK_S):
                return

    def look(self) -> None:
        """Read the result and the history again if they have changed."""
        path = self.folder / REPORT
        try:
            if (stamp := _get_stamp(path)) is None:
                self._stamp, self.last = None, LastCheck(fault=f"{path} is not there")
                return
            if stamp != self._stamp:
                self._last_read, self._stamp = self._read(path), stamp
            # Read the history last: a check is in it before it is in the result.
            path = self.folder / HISTORY
            fault = self._last_read.fault or self._chain.fault(self._last_read.checks)
            self.last = LastCheck(fault=fault) if fault else self._last_read
        except Exception as error:  # any content of a file: continue with the next look
            self._stamp = None
            self.last = LastCheck(fault=f"{path} cannot be read: {' '.join(str(error).split())}")

    def _read(self, path: Path) -> LastCheck:
        result = load_json_data(path, read_input(path, MOST_BYTES))
        last = parse_result(result)
        arm = result.get("arm", self._serial_number)  # older results lack it
        if arm != self._serial_number:
            return LastCheck(fault=f"{path} is of arm {arm}, expected one of {self._serial_number}")
        return last


def parse_result(result: dict[str, Any]) -> LastCheck:
    """Return the part of a result of `armd interim` that the daemon needs.

    Raises `ValueError` for another schema.
    """
    if result["schema"] != "armd.interim/1":
        raise ValueError(f"schema {result['schema']!r}")
    last = result["checks"][-1]
    changed = ""
    if result["state"] == "changed":
        change = result["changes"][-1]
        since = change["between"][0][:16].replace("T", " ")
        location = "" if change["location"] == "-" else f", {change['location']}"
        changed = (
            f"{change['cause'].replace('_', ' ')}{location}, since {since} UTC at the earliest"
        )
    started = datetime.datetime.fromisoformat(last["started"]).timestamp()
    judged = str(result["calibration"])
    since_then = sum(change["judged_under"] == judged for change in result["changes"])
    name, checks = str(last["name"]), len(result["checks"])
    return LastCheck("", name, started, changed, judged, since_then, checks)


def explain_complaints(
    last: LastCheck | None,
    in_use: Mapping[str, Any],
    now_unix_s: float,
    at_most_h: float | None,
) -> tuple[str, str]:
    """Return why the arm counts as changed, and why a check is due, each "" if not.

    *in_use* is the `provenance` of the calibration in use. A calibration that was made from these
    checks and includes their changes does not count as changed.
    """
    if last is None:
        return "", ""
    if last.fault:
        return "", f"no interim check known: {last.fault}"
    changed = ""
    correction = in_use.get("interim")
    has_them = (
        isinstance(correction, dict)
        and correction.get("calibration") == last.judged
        and len(correction.get("changes", ())) >= last.changes
    )
    if last.changed and not has_them:
        changed = f"interim checks say that the arm has changed: {last.changed}"
    hours = (now_unix_s - last.started_unix_s) / HOUR_S
    overdue = ""
    if at_most_h is not None and hours > at_most_h:
        overdue = (
            f"interim check overdue: the last, {last.name}, is {hours:.0f} h old ({at_most_h:g})"
        )
    elif at_most_h is not None and hours < -CLOCKS_APART_H:
        overdue = (
            f"no age of the last interim check: {last.name} is dated {-hours:.0f} h after now "
            "by this computer's clock"
        )
    return changed, overdue

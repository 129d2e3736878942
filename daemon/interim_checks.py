"""What the history of interim checks says of this arm, watched beside the stream.

`armd interim add` leaves its result in the history's folder. A thread reads it now and then: the
folder may lie on a disk that is asleep, or on another machine. The result is of the history beside
it: where that was edited or cut short, it says nothing any more.
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

#: How often the folder is looked at, s.
LOOK_S = 5.0
HOUR_S = 3600.0
#: A check dated farther ahead than this was dated by a clock that is wrong, or ours is.
CLOCKS_APART_H = 1.0
#: A history of ten years is a few megabytes.
MOST_BYTES = 1 << 26


@dataclass(frozen=True)
class LastCheck:
    """The history's word; what is wrong with the history itself stands in `fault`."""

    fault: str = ""
    name: str = ""
    started_unix_s: float = 0.0
    changed: str = ""  # since when and why; "" in control
    judged: str = ""  # SHA-256 of the calibration that the checks are of
    changes: int = 0  # since that calibration
    checks: int = 0


class WatchedChain:
    """A history's lines, watched: they only ever become more. A folder with a result and no history
    (a copy) has none to watch."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._stamps: object = ()
        self._checked_chain = self._now = HistoryChain[HistoryLine]()

    def fault(self, checks: int) -> str:
        """What is wrong with the history, of which a result tells *checks*; "" if nothing. Raises
        `BadInput` where it is broken."""
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
    """What tells a file from another state of it; None where there is none."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


class InterimChecks:
    """`last` is the history's word as it was read last; None until then."""

    def __init__(self, folder: Path, serial_number: str) -> None:
        """*serial_number*: of the arm that the checks must be of."""
        self.folder = folder
        self._serial_number = serial_number
        self.last: LastCheck | None = None
        self._last_read = LastCheck()  # by the result of this stamp
        self._stamp: tuple[int, int, int] | None = None
        self._chain = WatchedChain(folder)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="interim checks", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def close(self) -> None:
        """Look no more; does not wait for a disk."""
        self._ended.set()

    def _run(self) -> None:
        while True:
            self.look()
            if self._ended.wait(LOOK_S):
                return

    def look(self) -> None:
        """Read the result and the history, where they are others than before."""
        path = self.folder / REPORT
        try:
            if (stamp := _get_stamp(path)) is None:
                self._stamp, self.last = None, LastCheck(fault=f"{path} is not there")
                return
            if stamp != self._stamp:
                self._last_read, self._stamp = self._read(path), stamp
            # After the result, which is never of a check that the history has not yet.
            path = self.folder / HISTORY
            fault = self._last_read.fault or self._chain.fault(self._last_read.checks)
            self.last = LastCheck(fault=fault) if fault else self._last_read
        except Exception as error:  # whatever a foreign file holds, the next look comes
            self._stamp = None
            self.last = LastCheck(fault=f"{path} cannot be read: {' '.join(str(error).split())}")

    def _read(self, path: Path) -> LastCheck:
        result = load_json_data(path, read_input(path, MOST_BYTES))
        last = parse_result(result)
        arm = result.get("arm", self._serial_number)  # older results do not tell
        if arm != self._serial_number:
            return LastCheck(fault=f"{path} is of arm {arm}, expected one of {self._serial_number}")
        return last


def parse_result(result: dict[str, Any]) -> LastCheck:
    """What the daemon needs of a result of `armd interim`."""
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
    """Why the arm is changed, and why its checks are due: in words, "" for what is as it should be.

    *in_use*: where the calibration in use comes from, its `provenance`. One that was made from
    these checks and has their changes is as good as the one before was before them.
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

"""The history of calibrations of an arm's tips, in the state folder.

It has JSON lines, synced; the last calibration of a tip can be activated from here.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any
from urllib.parse import quote

from armd.client import Arm
from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.files.state_folder import find_state_folder
from armd.files.writing import explain_os_errors

SCHEMA = "armd.tip/1"
GOOD = "good"  # the verdict without doubts
#: Limit of a history's file; a calibration takes a kilobyte.
MOST_BYTES = 64 << 20


def locate_history_file(serial: str) -> Path:
    """Return the path of one arm's history."""
    return find_state_folder() / "tips" / f"{quote(serial, safe=' ')}.jsonl"


def read_history(serial: str, name: str | None = None) -> list[dict[str, Any]]:
    """Return the calibrations of one tip or of all, the oldest first.

    A line that is not a calibration is skipped. A line that a power cut cut short was never
    reported as stored.
    """
    path = locate_history_file(serial)
    if not path.exists():
        return []
    entries = []
    for line in read_input(path, MOST_BYTES).splitlines():
        try:
            entry = json.loads(line)
        except (ValueError, RecursionError):
            continue
        ours = isinstance(entry, dict) and entry.get("schema") == SCHEMA
        if ours and name in (None, entry.get("name")):
            entries.append(entry)
    return entries


def keep(serial: str, entry: dict[str, Any]) -> Path:
    """Append a calibration, which is on the disk when this returns; raises `BadInput`."""
    path = locate_history_file(serial)
    line = json.dumps({"schema": SCHEMA, **entry}, allow_nan=False) + "\n"
    with explain_os_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o750)
        with path.open("ab") as file:
            if file.tell() and not path.read_bytes().endswith(b"\n"):
                file.write(b"\n")  # ends a line that was cut short
            file.write(line.encode())
            file.flush()
            os.fsync(file.fileno())
    return path


def use_tip(arm: Arm, name: str) -> str:
    """Make a running daemon use and store the last calibration of a tip; return its answer.

    Raises `BadInput` for a tip without a calibration or with a doubtful one, and `ArmdError` where
    the daemon refuses.
    """
    path, entries = locate_history_file(arm.serial), read_history(arm.serial, name)
    if not entries:
        raise BadInput(path, f"tip {name!r}", "no calibration", "one by `armd measure tip`")
    last = entries[-1]
    if last["verdict"] != GOOD:
        raise BadInput(path, f"tip {name!r}", f"a {last['verdict']}", "a good one")
    offset = ",".join(repr(float(value)) for value in last["offset_mm"])
    radius = "" if last["radius_mm"] is None else repr(float(last["radius_mm"]))
    return arm.command("keep_tip", name=name, offset_mm=offset, radius_mm=radius)

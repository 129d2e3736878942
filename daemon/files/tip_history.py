"""Calibrations of an arm's tips, one after another, in the state folder: JSON lines, synced; the
last one of a tip is put in force from here."""

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
#: A calibration takes a kilobyte.
MOST_BYTES = 64 << 20


def locate_history_file(serial: str) -> Path:
    """Of one arm."""
    return find_state_folder() / "tips" / f"{quote(serial, safe=' ')}.jsonl"


def read_history(serial: str, name: str | None = None) -> list[dict[str, Any]]:
    """Calibrations of one tip or of all, the oldest first. A line that is none is passed over: what
    a power cut tore was never told as kept."""
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
    """Append one more; on the disk when this returns. Raises `BadInput` where it cannot be."""
    path = locate_history_file(serial)
    line = json.dumps({"schema": SCHEMA, **entry}, allow_nan=False) + "\n"
    with explain_os_errors(path):
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o750)
        with path.open("ab") as file:
            if file.tell() and not path.read_bytes().endswith(b"\n"):
                file.write(b"\n")  # the end of a torn line, which stands alone
            file.write(line.encode())
            file.flush()
            os.fsync(file.fileno())
    return path


def use_tip(arm: Arm, name: str) -> str:
    """A running daemon measures with the last calibration of a tip, and keeps it; returns what it
    says. Raises `BadInput` for a tip that has none, or a doubtful one, and `ArmdError` where the
    daemon refuses."""
    path, entries = locate_history_file(arm.serial), read_history(arm.serial, name)
    if not entries:
        raise BadInput(path, f"tip {name!r}", "no calibration", "one by `armd measure tip`")
    last = entries[-1]
    if last["verdict"] != GOOD:
        raise BadInput(path, f"tip {name!r}", f"a {last['verdict']}", "a good one")
    offset = ",".join(repr(float(value)) for value in last["offset_mm"])
    radius = "" if last["radius_mm"] is None else repr(float(last["radius_mm"]))
    return arm.command("keep_tip", name=name, offset_mm=offset, radius_mm=radius)

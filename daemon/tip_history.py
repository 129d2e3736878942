"""Calibrations of an arm's tips, one after another, in the state folder: JSON lines, synced."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any
from urllib.parse import quote

from armd.files import told
from armd.inputs import read_input
from armd.state_folder import state_folder

SCHEMA = "armd.tip/1"
#: A calibration takes a kilobyte.
MOST_BYTES = 64 << 20


def history_file(serial: str) -> Path:
    """Of one arm."""
    return state_folder() / "tips" / f"{quote(serial, safe=' ')}.jsonl"


def history(serial: str, name: str | None = None) -> list[dict[str, Any]]:
    """Calibrations of one tip or of all, the oldest first. A line that is none is passed over: what
    a power cut tore was never told as kept."""
    path = history_file(serial)
    if not path.exists():
        return []
    found = []
    for line in read_input(path, MOST_BYTES).splitlines():
        try:
            entry = json.loads(line)
        except (ValueError, RecursionError):
            continue
        ours = isinstance(entry, dict) and entry.get("schema") == SCHEMA
        if ours and name in (None, entry.get("name")):
            found.append(entry)
    return found


def keep(serial: str, entry: dict[str, Any]) -> Path:
    """Append one more; on the disk when this returns. Raises `BadInput` where it cannot be."""
    path = history_file(serial)
    line = json.dumps({"schema": SCHEMA, **entry}, allow_nan=False) + "\n"
    with told(path):
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o750)
        with path.open("ab") as file:
            if file.tell() and not path.read_bytes().endswith(b"\n"):
                file.write(b"\n")  # the end of a torn line, which stands alone
            file.write(line.encode())
            file.flush()
            os.fsync(file.fileno())
    return path

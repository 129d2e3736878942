"""A history of interim checks, as far as its chain goes: lines and head, without the checks."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path


def write_history(folder: Path, names: Sequence[str]) -> list[str]:
    """Write checks of these *names* to *folder*; the SHA-256 of each line. Files appear whole, the
    lines before the head that counts them."""
    previous, text, hashes = "0" * 64, b"", []
    for number, name in enumerate(names, 1):
        line = {
            "schema": "armd.interim.check/1", "check": number, "name": name,
            "started": "2026-03-07T12:00:00Z", "arm": "SIM-0001", "first_unix_s": 1.0,
            "last_unix_s": 2.0, "folder": name, "files": {}, "arm_file": "", "calibration": "",
            "added": "2026-03-07T12:10:00Z", "previous": previous,
        }  # fmt: skip
        data = json.dumps(line).encode()
        previous = hashlib.sha256(data).hexdigest()
        hashes.append(previous)
        text += data + b"\n"
    _replace(folder / "history.jsonl", text)
    head = {"schema": "armd.interim.head/1", "checks": len(names), "sha256": previous}
    _replace(folder / "head.json", json.dumps(head).encode())
    return hashes


def _replace(path: Path, data: bytes) -> None:
    part = path.with_name(f".{path.name}.part")
    part.write_bytes(data)
    part.rename(path)

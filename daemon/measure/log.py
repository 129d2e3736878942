"""The log of a guided measurement: JSON lines, appended and synced one by one.

A reading that was reported as taken is here after a kill or a power cut. The session's folder can
be rebuilt from the log at any time.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from armd.compensation.data.sessions.files import READINGS
from armd.errors import BadInput
from armd.files.locking import O_CLOEXEC, O_NOFOLLOW, lock_file
from armd.files.outputs import check_output_folder
from armd.files.schema import KeyTwice, decode_json_text
from armd.files.writing import check_folder, explain_os_errors, flush_folder, write_all

NAME = "measuring.jsonl"
SCHEMA = "armd.measuring/1"
#: Limit of a log: ten thousand readings at a kilobyte each, and refusals.
MOST_BYTES = 64 << 20

Entry = dict[str, Any]


class Log:
    """The open log with one writer; a second writer is refused. Close it."""

    def __init__(self, folder: Path, header: Mapping[str, Any]) -> None:
        """Begin in *folder* with *header*, or continue its log.

        `header` and `past` are then those of the log. Raises `BadInput` for a folder of another
        session, or a damaged log.
        """
        check_output_folder(folder)
        path = folder / NAME
        if not path.exists():
            for name in ("session.toml", *READINGS, "arm.toml"):  # arm.toml is written here, too
                if (folder / name).exists():
                    expected = "a new folder, or one that `armd measure` began"
                    raise BadInput(folder, "the folder", name, expected)
        with explain_os_errors(path):
            folder.mkdir(parents=True, exist_ok=True)
            check_folder(folder)
            flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | O_NOFOLLOW | O_CLOEXEC
            self._handle = os.open(path, flags, 0o666)
        try:
            self._lock(path)
            lines = self._whole_lines(path)
            if lines:
                self.header, self.past = lines[0], lines[1:]
            else:
                self.header, self.past = {"schema": SCHEMA, **header}, []
                self.append(self.header)
                flush_folder(folder)
        except BaseException:
            self.close()
            raise
        if self.header.get("schema") != SCHEMA:
            self.close()
            raise BadInput(path, "line 1", repr(self.header.get("schema")), repr(SCHEMA))

    def append(self, entry: Mapping[str, Any]) -> None:
        """Append an entry, which is on the disk when this returns.

        Raises `BadInput` if it cannot be written; then no part of it is there.
        """
        data = (json.dumps(entry, allow_nan=False, separators=(",", ":")) + "\n").encode()
        size = os.fstat(self._handle).st_size
        with explain_os_errors(Path(NAME)):
            try:
                write_all(self._handle, data)
                os.fsync(self._handle)
            except BaseException:
                os.ftruncate(self._handle, size)
                raise

    def close(self) -> None:
        if self._handle >= 0:
            os.close(self._handle)
            self._handle = -1

    def _lock(self, path: Path) -> None:
        try:
            lock_file(self._handle, wait=False)
        except BlockingIOError:
            problem = "another armd measuring into it"
            raise BadInput(path, "the session", problem, "one at a time") from None

    def _whole_lines(self, path: Path) -> list[Entry]:
        """Return the entries of the log.

        A line that a kill cut short was never reported as taken, and is removed.
        """
        size = os.fstat(self._handle).st_size
        if size > MOST_BYTES:
            raise BadInput(path, "the file", f"{size} bytes", f"{MOST_BYTES} at most")
        data = b""
        while len(data) < size and (piece := os.pread(self._handle, size - len(data), len(data))):
            data += piece
        complete_bytes = data.rfind(b"\n") + 1
        if complete_bytes < len(data):
            os.ftruncate(self._handle, complete_bytes)
            os.fsync(self._handle)
        lines = []
        for number, line in enumerate(data[:complete_bytes].split(b"\n")[:-1], 1):
            entry = _parse(path, number, line, "a line of this log")
            if not isinstance(entry, dict):
                raise BadInput(path, f"line {number}", "no object", "a line of this log")
            lines.append(entry)
        return lines


def load_beginning(folder: Path) -> Entry | None:
    """Return the first entry of the log in *folder*; None without a log.

    Raises `BadInput`.
    """
    path = folder / NAME
    if not path.exists():
        return None
    with explain_os_errors(path), path.open("rb") as file:
        line = file.readline(MOST_BYTES)
    entry = _parse(path, 1, line, "the log of a guided measurement")
    if not isinstance(entry, dict) or entry.get("schema") != SCHEMA:
        raise BadInput(path, "line 1", "something else", f"the schema {SCHEMA!r}")
    return entry


def _parse(path: Path, number: int, line: bytes, expected: str) -> Any:
    location = f"line {number}"
    try:
        return decode_json_text(line)
    except KeyTwice as error:
        raise BadInput(path, f"{location}: {error.key}", error.description, "it once") from error
    except (ValueError, RecursionError) as error:
        raise BadInput(path, location, "no JSON", expected) from error

"""Log of measurements on the controller's disk, so that no press is ever lost.

Each arm has a folder with JSON lines as published, one file after another. Each batch of lines is
synced to the disk before the next is taken. A separate thread writes: a slow disk delays no point.
"""

from __future__ import annotations

import os
import queue
import threading
import time
from collections import deque
from pathlib import Path
from urllib.parse import quote, unquote

from armd.drivers.sample import Event
from armd.files.state_folder import find_state_folder
from armd.files.writing import write_all

SUFFIX = ".jsonl"
#: Limit of a file: some twenty thousand measurements, quick to copy and to open.
MOST_BYTES = 16 << 20
#: Lines held for a disk that is full or gone; beyond that the oldest are lost, with an event.
MOST_WAITING = 10_000
RETRY_S = 1.0


def locate_logs_folder() -> Path:
    """Return the folder of the logs of all this machine's arms, in the state folder."""
    return find_state_folder() / "measurements"


def locate_log_folder(serial: str) -> Path:
    """Return the folder of one arm's log."""
    return locate_logs_folder() / quote(serial, safe=" ")


def parse_serial(folder: Path) -> str:
    """Return the serial number of the arm whose log a folder holds, from its name."""
    return unquote(folder.name)


class MeasurementLog:
    """A log that is written from its construction to `close`."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._came: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._events: deque[Event] = deque(maxlen=16)
        self._waiting: deque[str] = deque()
        self._lost = 0
        self._failed = ""
        self._thread = threading.Thread(target=self._run, name="measurement-log", daemon=True)
        self._thread.start()

    def add(self, line: str) -> None:
        """Queue a line; never blocks."""
        self._came.put(line)

    def take_events(self) -> list[Event]:
        """Return events, each once: writing fails, or works again."""
        events = []
        while self._events:
            events.append(self._events.popleft())
        return events

    def close(self, timeout_s: float = 1.0) -> None:
        """Stop, after writing the queued lines if the disk allows it within *timeout_s*."""
        self._came.put(None)
        self._thread.join(timeout_s)

    def _run(self) -> None:
        open_ = True
        while open_:
            open_ = self._take_up()
            if not self._waiting:
                continue
            try:
                self._write()
            except Exception as error:  # the lines stay for the next attempt
                self._tell_failure(error)
            else:
                self._tell_success()

    def _take_up(self) -> bool:
        """Wait for lines, at most until the next retry; return whether more may come."""
        try:
            line = self._came.get(timeout=RETRY_S if self._waiting else None)
            while line is not None:
                if len(self._waiting) == MOST_WAITING:
                    self._waiting.popleft()
                    self._lost += 1
                self._waiting.append(line)
                line = self._came.get_nowait()
        except queue.Empty:
            return True
        return False

    def _write(self) -> None:
        """Write all held lines; a line counts as written when it is synced."""
        self._folder.mkdir(parents=True, exist_ok=True, mode=0o750)
        lines = list(self._waiting)
        data = "".join(f"{line}\n" for line in lines).encode()
        handle = os.open(_choose_file(self._folder), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o640)
        try:
            size = os.lseek(handle, 0, os.SEEK_END)
            try:
                write_all(handle, _read_torn_end(handle, size) + data)
                os.fsync(handle)
            except OSError:
                os.ftruncate(handle, size)  # a disk became full: write all lines or none
                raise
        finally:
            os.close(handle)
        for _ in lines:
            self._waiting.popleft()

    def _tell_failure(self, error: Exception) -> None:
        if self._failed:
            return
        self._failed = f"{self._folder}: {getattr(error, 'strerror', None) or error}"
        text = f"measurements cannot be written to {self._failed}; they are kept in memory"
        self._events.append(Event("log_failed", text, time.monotonic_ns(), "error"))

    def _tell_success(self) -> None:
        if self._failed:
            lost = f"; {self._lost} were lost meanwhile" if self._lost else ""
            text = f"measurements are written to {self._folder} again{lost}"
            severity = "error" if lost else "info"
            self._events.append(Event("log_back", text, time.monotonic_ns(), severity))
        self._failed, self._lost = "", 0


def list_log_files(folder: Path) -> list[Path]:
    """List the files of a log's folder, the oldest first."""
    return sorted(path for path in folder.glob(f"*{SUFFIX}") if path.stem.isdecimal())


def _choose_file(folder: Path) -> Path:
    """Return the file to append to: the last one, or a new one when that is long enough."""
    files = list_log_files(folder)
    if files and files[-1].stat().st_size < MOST_BYTES:
        return files[-1]
    # Numbered, not dated: a controller's clock may run backwards.
    number = int(files[-1].stem) + 1 if files else 1
    return folder / f"{number:06d}{SUFFIX}"


def _read_torn_end(handle: int, size: int) -> bytes:
    """Return a line break if the last line was cut short, so that it stays a separate line."""
    return b"\n" if size > 0 and os.pread(handle, 1, size - 1) != b"\n" else b""

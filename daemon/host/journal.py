"""Write events for people: one line each, in limited numbers; to systemd with fields.

The stream of points never waits for a log: the journal's socket does not block, and a separate
thread writes the lines. A disk may be full, a file closed, a pipe not read.
"""

from __future__ import annotations

import json
import os
import queue
import socket
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TextIO

from armd.drivers.sample import Event
from armd.printable import to_printable

#: Limit of lines for one kind of event, and its period: one for each joint and sensor that an arm
#: can have; further ones are counted.
BURST = 20
BURST_S = 10.0
#: Queued lines for a standard error that is not read; further ones are dropped.
WAITING = 1000
#: Time that the daemon's end waits for the last lines.
DRAIN_S = 0.5
JOURNAL = "/run/systemd/journal/socket"
_PRIORITY = {"error": 3, "warning": 4, "info": 6}


class Journal:
    """Writes events to the journal if *stream* is the journal's, else as lines to *stream*."""

    def __init__(
        self,
        stream: TextIO | None = sys.stderr,
        clock_s: Callable[[], float] = time.monotonic,
        journal: str = JOURNAL,
    ) -> None:
        self._lines = _Lines(_get_descriptor(stream))
        self._clock_s = clock_s
        self._journal = _connect(journal) if _is_journal(stream) else None
        self._windows: dict[str, tuple[float, int]] = {}  # kind → start, lines since

    def write(self, event: Event) -> None:
        """Write a line: `armd: warning: silence: no samples for 0.5 s {"port": "/dev/…"}`."""
        now_s = self._clock_s()
        start_s, lines = self._windows.get(event.kind, (now_s, 0))
        suppressed = 0
        if now_s - start_s >= BURST_S:
            suppressed = max(0, lines - BURST)
            start_s, lines = now_s, 0
        self._windows[event.kind] = (start_s, lines + 1)
        if lines >= BURST:
            return
        detail = json.dumps(event.detail) if event.detail else ""
        suppressed_text = f"({suppressed} more before)" if suppressed else ""
        text = " ".join(
            part for part in (f"{event.kind}: {event.text}", detail, suppressed_text) if part
        )
        self._put(event.severity, event.kind, text, detail)

    def tell_rest(self) -> None:
        """Write how many lines of an ended flood were skipped; call it now and then."""
        now_s = self._clock_s()
        for kind, (start_s, lines) in list(self._windows.items()):
            if now_s - start_s < BURST_S:
                continue
            del self._windows[kind]
            if lines > BURST:
                self._put("info", kind, f"{kind}: {lines - BURST} more in {now_s - start_s:.0f} s")

    def close(self) -> None:
        self._lines.close()
        if self._journal is not None:
            self._journal.close()

    def _put(self, severity: str, kind: str, text: str, detail: str = "") -> None:
        text = to_printable(
            text
        )  # a serial number may be anything; journalctl hides unprintable text
        if self._journal is None or not self._send(severity, kind, text, detail):
            self._lines.put(f"armd: {severity}: {text}\n")

    def _send(self, severity: str, kind: str, text: str, detail: str) -> bool:
        """Send a line by systemd's native protocol; return whether it was sent.

        `journalctl ARMD_KIND=silence -o json` finds it again.
        """
        fields = {
            "MESSAGE": text,
            "PRIORITY": str(_PRIORITY[severity]),
            "SYSLOG_IDENTIFIER": "armd",
            "ARMD_KIND": kind,
            "ARMD_DETAIL": detail or "{}",
        }
        lines = (f"{name}={' '.join(value.splitlines())}\n" for name, value in fields.items())
        assert self._journal is not None
        with suppress(OSError):  # while the journal restarts, the line goes to the stream
            self._journal.send("".join(lines).encode())
            return True
        return False


class _Lines:
    """A queue of lines for a file descriptor; a thread writes them."""

    def __init__(self, descriptor: int | None) -> None:
        self._descriptor = descriptor
        self._queue: queue.Queue[bytes | None] = queue.Queue(WAITING)
        self._dropped = 0
        self._thread = threading.Thread(target=self._write, name="log", daemon=True)
        if descriptor is not None:
            self._thread.start()

    def put(self, line: str) -> None:
        if self._descriptor is None:
            return
        try:
            if self._dropped:
                lost = f"armd: warning: log: {self._dropped} lines were not written\n"
                self._queue.put_nowait(lost.encode())
                self._dropped = 0
            self._queue.put_nowait(line.encode(errors="backslashreplace"))
        except queue.Full:
            self._dropped += 1

    def close(self) -> None:
        """Wait for the queued lines, for `DRAIN_S` at most."""
        with suppress(queue.Full):
            self._queue.put_nowait(None)
            if self._thread.is_alive():
                self._thread.join(DRAIN_S)

    def _write(self) -> None:
        # Not by Python's own stream: if that blocked, it would keep its lock and stop the process.
        assert self._descriptor is not None
        while (line := self._queue.get()) is not None:
            with suppress(OSError):
                while line:
                    line = line[os.write(self._descriptor, line) :]


def keep_standard_streams_open() -> None:
    """Open descriptors below 3 that are closed.

    Else the next file opened, perhaps the arm's port, would get the number and the text of standard
    error.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number


def print_line(line: str) -> None:
    """Print a line on standard output, if it can be written."""
    try:
        print(line, flush=True)
    except OSError:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.stdout.fileno())  # the buffered text would fail again at the end
        os.close(null)


def _get_descriptor(stream: TextIO | None) -> int | None:
    if stream is None:
        return None
    with suppress(OSError, ValueError):  # closed
        return stream.fileno()
    return None


def _is_journal(stream: TextIO | None) -> bool:
    """Return whether *stream* is the journal's.

    systemd names the file that its journal reads; a process with a redirected stream keeps the
    variable.
    """
    descriptor = _get_descriptor(stream)
    if descriptor is None:
        return False
    with suppress(OSError):
        status = os.fstat(descriptor)
        return os.environ.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"
    return False


def _connect(journal: str) -> socket.socket | None:
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    connection.setblocking(False)  # the stream of points must not wait for a log
    try:
        connection.connect(journal)
    except OSError:
        connection.close()
        return None
    return connection

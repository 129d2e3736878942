"""Events for people: one line each, never a flood; under systemd with fields to search by."""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from typing import TextIO

from armd.drivers.sample import Event

#: Of one kind of event this many lines are written in this time; the rest is counted.
BURST = 5
BURST_S = 10.0
JOURNAL = "/run/systemd/journal/socket"
_PRIORITY = {"error": 3, "warning": 4, "info": 6}


class Log:
    """Writes events to the journal if *stream* is the journal's, else as lines to *stream*."""

    def __init__(
        self,
        stream: TextIO = sys.stderr,
        clock_s: Callable[[], float] = time.monotonic,
        journal: str = JOURNAL,
    ) -> None:
        self._stream = stream
        self._clock_s = clock_s
        self._journal = _connect(journal) if _is_journal(stream) else None
        self._windows: dict[str, tuple[float, int]] = {}  # kind → start, lines since

    def write(self, event: Event) -> None:
        """`armd: warning: silence: no samples for 0.5 s {"port": "/dev/…"}`"""
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
        more = f"({suppressed} more before)" if suppressed else ""
        text = " ".join(part for part in (f"{event.kind}: {event.text}", detail, more) if part)
        if self._journal is None or not self._send(event, text, detail):
            print(f"armd: {event.severity}: {text}", file=self._stream, flush=True)

    def close(self) -> None:
        if self._journal is not None:
            self._journal.close()

    def _send(self, event: Event, text: str, detail: str) -> bool:
        """systemd's native protocol: `journalctl ARMD_KIND=silence -o json` finds it again."""
        fields = {
            "MESSAGE": text,
            "PRIORITY": str(_PRIORITY[event.severity]),
            "SYSLOG_IDENTIFIER": "armd",
            "ARMD_KIND": event.kind,
            "ARMD_DETAIL": detail or "{}",
        }
        lines = (f"{name}={' '.join(value.splitlines())}\n" for name, value in fields.items())
        assert self._journal is not None
        with suppress(OSError):  # the journal restarts: the line goes to the stream, which it keeps
            self._journal.send("".join(lines).encode())
            return True
        return False


def _is_journal(stream: TextIO) -> bool:
    """systemd tells which file its journal reads; whoever redirects it away keeps the variable."""
    with suppress(OSError, ValueError):
        status = os.fstat(stream.fileno())
        return os.environ.get("JOURNAL_STREAM") == f"{status.st_dev}:{status.st_ino}"
    return False


def _connect(journal: str) -> socket.socket | None:
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    connection.setblocking(False)  # the stream of points waits for no log
    try:
        connection.connect(journal)
    except OSError:
        connection.close()
        return None
    return connection

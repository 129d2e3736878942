"""One line per event on standard error, as the journal likes it, and never a flood."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Callable
from typing import TextIO

from armd.drivers.sample import Event

#: Of one kind of event this many lines are written in this time; the rest is counted.
BURST = 5
BURST_S = 10.0
_PRIORITY = {"error": "<3>", "warning": "<4>", "info": "<6>"}


class Log:
    """Writes events; under systemd with the priority the journal reads."""

    def __init__(
        self, stream: TextIO = sys.stderr, clock_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._stream = stream
        self._clock_s = clock_s
        self._journal = "JOURNAL_STREAM" in os.environ
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
        priority = _PRIORITY[event.severity] if self._journal else ""
        detail = f" {json.dumps(event.detail)}" if event.detail else ""
        more = f" ({suppressed} more before)" if suppressed else ""
        print(
            f"{priority}armd: {event.severity}: {event.kind}: {event.text}{detail}{more}",
            file=self._stream,
            flush=True,
        )

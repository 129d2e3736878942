"""What a shared host takes of this machine, moment by moment, as Linux counts it; of a machine of
one's own nobody takes anything."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import numpy as np

PERIOD_S = 0.05
#: The count comes in hundredths of a second, and may come this late.
LATE_NS = 20_000_000


class Stolen:
    """A thread that notes the count, while it is entered."""

    def __enter__(self) -> Stolen:
        self._at_ns: list[int] = []
        self._stolen_s: list[float] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()

    def between(self, begin_ns: int, end_ns: int) -> float:
        """Seconds of all processors taken between two instants that are past."""
        window = (begin_ns - LATE_NS, end_ns + LATE_NS)
        n = len(self._stolen_s)  # the thread goes on
        begin_s, end_s = np.interp(window, self._at_ns[:n], self._stolen_s[:n])
        return float(end_s - begin_s)

    def _watch(self) -> None:
        while not self._done.wait(PERIOD_S):
            fields = Path("/proc/stat").read_text().split("\n", 1)[0].split()
            self._at_ns.append(time.monotonic_ns())
            self._stolen_s.append(int(fields[8]) / os.sysconf("SC_CLK_TCK"))

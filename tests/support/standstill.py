"""Whether the machine ran us: a shared host takes processors away, for a tenth of a second or more.

    with Standstill() as machine:
        ...                    # something with deadlines
    machine.longest_s          # for which one of the processors did not run what was due

`support.punctuality` uses it, beside what the kernel counts.
"""

from __future__ import annotations

import os
import threading
import time

PERIOD_S = 0.01


class Standstill:
    """A thread on each processor that wakes up every 10 ms and looks how late it is."""

    def __enter__(self) -> Standstill:
        self.longest_s = 0.0
        self._done = threading.Event()
        self._threads = [
            threading.Thread(target=self._watch, args=(processor,), daemon=True)
            for processor in os.sched_getaffinity(0)
        ]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        for thread in self._threads:
            thread.join()

    def _watch(self, processor: int) -> None:
        os.sched_setaffinity(0, {processor})  # this thread's alone
        before = time.monotonic()
        while not self._done.wait(PERIOD_S):
            now = time.monotonic()
            self.longest_s = max(self.longest_s, now - before - PERIOD_S)
            before = now

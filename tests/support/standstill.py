"""Whether the machine ran us: a shared host takes processors away, for a tenth of a second or more.

    with Standstill() as machine:
        ...                    # something with deadlines
    machine.longest_s          # for which one of the processors did not run what was due

A test of deadlines in a simulated arm, whose nodes then answer too late, is a test of the host when
this is long; `taken_while_it_ran` takes such a run again, by what was measured here alone and never
by how the tests on it end.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from typing import TypeVar

Run = TypeVar("Run")

PERIOD_S = 0.01
#: Longer, and what waits for an answer, or for the end of a fault, waits too short.
LONG_S = 0.4
#: The same on a line of servos: after so long without a byte no more answers are waited for.
SERVO_LONG_S = 0.03
TAKES = 3


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


def taken_while_it_ran(take: Callable[[], Run], long_s: float = LONG_S) -> Run:
    """What *take* returns from the first of three runs without a standstill of *long_s*, else from
    the one with the shortest."""
    runs: list[tuple[float, Run]] = []
    while len(runs) < TAKES:
        with Standstill() as machine:
            run = take()
        runs.append((machine.longest_s, run))
        if machine.longest_s < long_s:
            break
        print(f"the machine stood still for {machine.longest_s:.2f} s")  # shown where a test fails
    return min(runs, key=lambda run: run[0])[1]

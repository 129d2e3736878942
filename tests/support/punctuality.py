"""Judges a limit in seconds by what the machine gave while it ran.

    def test_it_stops(punctuality):
        with punctuality.watch() as machine:
            code, seconds = daemon.stop()
        assert code == 0
        machine.judge(seconds, 3.0, "armd run ends after SIGTERM")

A limit that is missed counts only without the time in which some process waited for a processor.
Otherwise it was not judged; the end of the run counts and lists such limits. The same holds for
samples that were lost, and reported as lost. What a test asserts of values it asserts in any case.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from support.standstill import Standstill

PRESSURE = Path("/proc/pressure/cpu")
STARVED = 0.3  # of the time; a live test alone on two processors waits for less
TICKS_PER_S = 100  # USER_HZ, of /proc/stat on every Linux

_unjudged: list[str] = []


def read_waiting_s() -> float:
    """Returns the seconds in which a process waited for a processor, since the machine started.

    Time that a hypervisor gave to other machines is included. A kernel without pressure
    information counts that alone.
    """
    stolen_s = int(Path("/proc/stat").read_text().split(maxsplit=9)[8]) / TICKS_PER_S
    try:
        some = PRESSURE.read_text().splitlines()[0]
    except OSError:
        return stolen_s
    return stolen_s + int(some.rpartition("total=")[2]) * 1e-6


class Machine:
    """What one machine withheld during one `watch`."""

    def __init__(self) -> None:
        self.waited_s = 0.0
        self.watched_s = 0.0

    def judge(self, took_s: float, limit_s: float, what: str) -> None:
        """Fails if *what* took longer than *limit_s*, and the machine does not explain that."""
        if took_s <= limit_s:
            return
        text = f"{what}: took {took_s:.2f} s, limit {limit_s:g} s, waited {self.waited_s:.2f} s"
        assert took_s - self.waited_s <= limit_s, text
        _unjudged.append(text)

    def judge_lost(self, lost: int, what: str) -> None:
        """Fails if *lost* is not 0, unless processes waited for a good part of the time.

        It takes a loss that was reported. That none goes unreported is the test's to assert.
        """
        if lost == 0:
            return
        text = f"{what}: lost {lost}, waited {self.waited_s:.2f} of {self.watched_s:.2f} s"
        assert self.waited_s > STARVED * self.watched_s, text
        _unjudged.append(text)

    def judge_gaps(self, seq: npt.NDArray[np.integer], what: str) -> None:
        """Fails if *seq* (n,) does not rise; its gaps are losses."""
        steps = np.diff(seq.astype(np.int64))
        assert (steps > 0).all(), what
        self.judge_lost(int((steps - 1).sum()), what)


class Punctuality:
    """Watches the machine, for tests and for fixtures of a whole module."""

    @contextmanager
    def watch(self) -> Iterator[Machine]:
        """Yields a machine whose `waited_s` is known after the block."""
        machine = Machine()
        before_s, began_s = read_waiting_s(), time.monotonic()
        with Standstill() as standstill:
            try:
                yield machine
            finally:
                machine.waited_s = read_waiting_s() - before_s
                machine.watched_s = time.monotonic() - began_s
        machine.waited_s += standstill.longest_s

    @contextmanager
    def limit(self, limit_s: float, what: str) -> Iterator[None]:
        """Judges the time that the block takes."""
        with self.watch() as machine:
            began_s = time.monotonic()
            yield
            took_s = time.monotonic() - began_s
        machine.judge(took_s, limit_s, what)


@pytest.fixture(scope="session")
def punctuality() -> Punctuality:
    return Punctuality()


def take_unjudged() -> list[str]:
    """Returns what was not judged since the last call."""
    texts = list(_unjudged)
    _unjudged.clear()
    return texts

"""Judges a limit in seconds by what the machine gave while it ran.

    def test_it_stops(punctuality):
        with punctuality.watch() as machine:
            code, seconds = daemon.stop()
        assert code == 0
        machine.judge(seconds, 3.0, "armd run ends after SIGTERM")

A limit that is missed counts only without the time in which some process waited for a processor.
Otherwise it was not judged; the end of the run counts and lists such limits. What a test asserts of
values it asserts in any case.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from support.standstill import Standstill

UNJUDGED = "unjudged"
PRESSURE = Path("/proc/pressure/cpu")
TICKS_PER_S = 100  # USER_HZ, of /proc/stat on every Linux


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

    def __init__(self, node: pytest.Item) -> None:
        self.waited_s = 0.0
        self._node = node

    def judge(self, took_s: float, limit_s: float, what: str) -> None:
        """Fails if *what* took longer than *limit_s*, and the machine does not explain that."""
        if took_s <= limit_s:
            return
        text = f"{what}: took {took_s:.2f} s, limit {limit_s:g} s, waited {self.waited_s:.2f} s"
        assert took_s - self.waited_s <= limit_s, text
        self._node.user_properties.append((UNJUDGED, text))


class Punctuality:
    """A test's own judge of limits in seconds."""

    def __init__(self, node: pytest.Item) -> None:
        self._node = node

    @contextmanager
    def watch(self) -> Iterator[Machine]:
        """Yields a machine whose `waited_s` is known after the block."""
        machine = Machine(self._node)
        before_s = read_waiting_s()
        with Standstill() as standstill:
            try:
                yield machine
            finally:
                machine.waited_s = read_waiting_s() - before_s
        machine.waited_s += standstill.longest_s

    @contextmanager
    def limit(self, limit_s: float, what: str) -> Iterator[None]:
        """Judges the time that the block takes."""
        with self.watch() as machine:
            began_s = time.monotonic()
            yield
            took_s = time.monotonic() - began_s
        machine.judge(took_s, limit_s, what)


@pytest.fixture
def punctuality(request: pytest.FixtureRequest) -> Punctuality:
    return Punctuality(request.node)

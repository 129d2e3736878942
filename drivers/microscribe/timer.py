"""The arm's timer on the host's clock.

Ticks of 1/900 s, 14 bits: a reading says in which tick it was made, not when within it. A reading
that was asked for was made between its request and its reply, so each bounds where that tick began;
`ClockMapping` makes of such bounds what it makes of PING and PONG.
"""

from __future__ import annotations

from collections import deque
from typing import Any

from armd.drivers.microscribe.wire import TICKS
from armd.drivers.serial.clock import OLD_NS, PROMISED_NS, WINDOW, ClockMapping

TICK_NS = 1_111_111  # of a 7.3728 MHz crystal, by 8192
SPREAD_NS = TICK_NS / 12**0.5  # of an instant within its tick
HOPELESS = 200  # polls in a row that did not map the clock


class Timer:
    def __init__(self) -> None:
        self._clock = ClockMapping(SPREAD_NS)
        self._exchanges: deque[tuple[int, int, int]] = deque(maxlen=WINDOW)  # of the clock, to keep
        self._total: tuple[int, int] | None = None  # ticks since the first, and the host's time
        self._vain = 0

    @property
    def mapped(self) -> bool:
        return self._clock.mapped

    @property
    def hopeless(self) -> bool:
        """It does not run as the maker says."""
        return self._vain > HOPELESS

    def ticks(self, reading: int, at_ns: int) -> int:
        """All ticks since the first, of a reading of 14 bits heard at *at_ns*: silence between two
        readings may last for many turns of it."""
        if self._total is None:
            total = reading
        else:
            before, before_ns = self._total
            expected = before + (at_ns - before_ns) * 9 // 10_000_000
            total = expected + (reading - expected + TICKS // 2) % TICKS - TICKS // 2
        self._total = total, at_ns
        return total

    def add_exchange(self, begin_ns: int, end_ns: int, ticks: int) -> None:
        """A reading made in tick *ticks*, and between two instants of the host."""
        self._add(begin_ns - TICK_NS, end_ns, _device_ns(ticks))
        self._vain = 0 if self.mapped else self._vain + 1

    def instant_ns(self, ticks: int, latest_ns: int) -> int | None:
        """The middle of where a reading of that tick, heard from *latest_ns* on, must lie; None:
        it cannot have been made in that tick."""
        begin_ns = self._clock.to_host(_device_ns(ticks))
        if begin_ns > latest_ns + PROMISED_NS:
            return None
        return (begin_ns + min(begin_ns + TICK_NS, latest_ns)) // 2

    def holds(self, ticks: int) -> bool:
        """Whether the mapping is young enough for that tick."""
        newest = self._exchanges[-1][2] if self._exchanges else 0
        return self.mapped and _device_ns(ticks) - newest <= OLD_NS

    def state(self) -> list[Any]:
        """For `restored`, as JSON."""
        return [self._total, list(self._exchanges)]

    @classmethod
    def restored(cls, state: list[Any]) -> Timer:
        timer = cls()
        total, exchanges = state
        timer._total = total and (total[0], total[1])
        for sent_ns, received_ns, device_ns in exchanges:
            timer._add(sent_ns, received_ns, device_ns)
        return timer

    def _add(self, sent_ns: int, received_ns: int, device_ns: int) -> None:
        if not self._clock.add(sent_ns, received_ns, device_ns):
            self._exchanges.clear()  # as the clock has done
        self._exchanges.append((sent_ns, received_ns, device_ns))


def _device_ns(ticks: int) -> int:
    return ticks * 10_000_000 // 9

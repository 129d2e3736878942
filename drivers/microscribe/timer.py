"""Maps the arm's timer to the host's clock.

The timer has ticks of 1/900 s and 14 bits. A reading carries its tick, but not the instant within
it. A requested reading was made between its request and its reply, so each bounds the beginning of
that tick. `ClockMapping` uses these bounds like PING and PONG.
"""

from __future__ import annotations

from collections import deque
from typing import Any

from armd.drivers.microscribe.wire import TICKS
from armd.drivers.serial.clock import OLD_NS, PROMISED_NS, WINDOW, ClockMapping

TICK_NS = 1_111_111  # a crystal of 7.3728 MHz, divided by 8192
SPREAD_NS = TICK_NS / 12**0.5  # standard deviation of an instant within its tick
HOPELESS = 200  # polls in a row that did not map the clock


class Timer:
    def __init__(self) -> None:
        self._clock = ClockMapping(SPREAD_NS)
        self._exchanges: deque[tuple[int, int, int]] = deque(maxlen=WINDOW)  # kept for `state`
        self._total: tuple[int, int] | None = None  # ticks since the first, and the host's time
        self._vain = 0

    @property
    def mapped(self) -> bool:
        return self._clock.mapped

    @property
    def hopeless(self) -> bool:
        """Whether the timer does not run at the rate that the maker states."""
        return self._vain > HOPELESS

    def ticks(self, reading: int, at_ns: int) -> int:
        """Return all ticks since the first, for a *reading* of 14 bits received at *at_ns*.

        A gap between two readings may be longer than the timer's period.
        """
        if self._total is None:
            total = reading
        else:
            before, before_ns = self._total
            expected = before + (at_ns - before_ns) * 9 // 10_000_000
            total = expected + (reading - expected + TICKS // 2) % TICKS - TICKS // 2
        self._total = total, at_ns
        return total

    def add_exchange(self, begin_ns: int, end_ns: int, ticks: int) -> None:
        """Add a reading made in tick *ticks*, between two instants of the host."""
        self._add(begin_ns - TICK_NS, end_ns, _device_ns(ticks))
        self._vain = 0 if self.mapped else self._vain + 1

    def instant_ns(self, ticks: int, latest_ns: int) -> int | None:
        """Return the middle of the interval in which a reading of that tick was made.

        *latest_ns*: the latest possible instant. None: it cannot have been made in that tick.
        """
        begin_ns = self._clock.to_host(_device_ns(ticks))
        if begin_ns > latest_ns + PROMISED_NS:
            return None
        return (begin_ns + min(begin_ns + TICK_NS, latest_ns)) // 2

    def holds(self, ticks: int) -> bool:
        """Return whether the mapping is recent enough for that tick."""
        newest = self._exchanges[-1][2] if self._exchanges else 0
        return self.mapped and _device_ns(ticks) - newest <= OLD_NS

    def state(self) -> list[Any]:
        """Return the state for `restored`, as JSON."""
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
            self._exchanges.clear()  # like the clock
        self._exchanges.append((sent_ns, received_ns, device_ns))


def _device_ns(ticks: int) -> int:
    return ticks * 10_000_000 // 9

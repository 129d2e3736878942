"""Decides whether the servos of a line are read one by one, as some answer no sync read."""

from __future__ import annotations

from collections.abc import Iterable

from armd.drivers.sample import Event

RATE_AFTER_NS = 1_000_000_000  # the rate is measured for this long before it is reported
#: LeRobot's users met such servos (its issue 1010).
WHY = "not the cable: their firmware is too old, or the adapter cannot; update the firmware"


class OneByOne:
    """The reading one by one of a line's servos; one event reports the rate."""

    def __init__(self, always: bool = False) -> None:
        """Start; *always*: the protocol has no sync read, so nothing is reported."""
        self.active = self._always = always
        self._servos: list[int] = []  # servos that answer no sync read
        self._reported = False
        self._began_ns: int | None = None
        self._cycles = 0

    def begin(self, servos: Iterable[int]) -> None:
        """Begin: *servos* answered a single read, and no sync read."""
        self.active = True
        self._servos = sorted(servos)

    def end(self) -> None:
        """End it with the connection."""
        self.active = self._always
        self._began_ns, self._cycles = None, 0

    def restore(self, active: bool) -> None:
        """Continue in the middle of a connection, whose event has been reported."""
        self._reported = active
        self.active = active or self._always

    def events(self, now_ns: int) -> list[Event]:
        """Count a cycle that began at *now_ns*; return the event when the rate is known."""
        if self._always:
            return []
        if self._began_ns is None:
            self._began_ns = now_ns
        if self._reported or now_ns - self._began_ns < RATE_AFTER_NS:
            self._cycles += 1
            return []
        self._reported = True
        rate_hz = self._cycles * 1e9 / (now_ns - self._began_ns)
        several = len(self._servos) > 1
        text = f"servo{'s' * several} {', '.join(map(str, self._servos))}"
        text += f" answer{'s' * (not several)} when asked alone, and no sync read ({WHY}):"
        text += f" all servos are read one by one, {rate_hz:.0f} cycles a second"
        detail = {"servos": self._servos, "rate_hz": round(rate_hz, 1)}
        return [Event("no_sync_read", text, now_ns, "warning", detail)]

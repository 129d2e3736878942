"""Detects an id that two servos have: one request gets two answers that differ."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterable

#: Contradictions that prove two servos; fewer may be due to a stray answer.
CERTAIN_AFTER = 3
#: A servo is believed again when its answers have been unambiguous for this long: after a stray
#: answer, after a second servo, and if only its temperature is read, twice a second.
STRAY_NS, CERTAIN_NS, AT_LEISURE_NS = 100_000_000, 500_000_000, 1_600_000_000


class Doubles:
    """The servos that contradict themselves. *often*: those that are asked in each cycle."""

    def __init__(self, often: Container[int]) -> None:
        self._often = often
        self._times: Counter[int] = Counter()  # contradictions since they were last believed
        self._last_ns: dict[int, int] = {}

    def __contains__(self, servo: object) -> bool:
        """Return whether the answers of *servo* must be ignored."""
        return servo in self._last_ns

    def contradicted(self, servo: int, now_ns: int) -> bool:
        """Record two different answers; return whether this one proves two servos."""
        self._times[servo] += 1
        self._last_ns[servo] = now_ns
        return self._times[servo] == CERTAIN_AFTER

    def heard(self, servo: int, now_ns: int) -> None:
        """Record a single answer."""
        since_ns = self._last_ns.get(servo)
        if since_ns is not None and now_ns - since_ns > self._patience_ns(servo):
            self.forget(servo)

    def forget(self, servo: int) -> None:
        self._times.pop(servo, None)
        self._last_ns.pop(servo, None)

    def _patience_ns(self, servo: int) -> int:
        if servo not in self._often:
            return AT_LEISURE_NS
        return STRAY_NS if self._times[servo] < CERTAIN_AFTER else CERTAIN_NS

    @property
    def certain(self) -> list[int]:
        return [servo for servo in self._last_ns if self._times[servo] >= CERTAIN_AFTER]

    def forget_all(self) -> None:
        self._times.clear()
        self._last_ns.clear()

    def state(self) -> list[tuple[int, int, int]]:
        return [(servo, self._times[servo], at_ns) for servo, at_ns in self._last_ns.items()]

    def restore(self, state: Iterable[tuple[int, int, int]]) -> None:
        """Restore *state*, after its way through JSON."""
        self.forget_all()
        for servo, times, at_ns in state:
            self._times[servo], self._last_ns[servo] = times, at_ns

"""Detects servos that answer without measuring: all send 0 or 1, wherever their shafts are."""

from __future__ import annotations

from collections.abc import Sequence

from armd.drivers.joint_watch import GOOD_FOR_NS
from armd.drivers.poll.protocol.family import COUNTS_PER_TURN
from armd.drivers.sample import Event

#: A joint moves this far from one cycle to the next only by a jump.
FAR_COUNTS = 64
STUCK = (
    "every servo's position: found 0 or 1, expected where its shaft is: the servos are stuck;"
    " switch their supply off and on"
)


class StuckWatch:
    """Watches one line. An arm whose joints move to 0 one by one is not stuck."""

    def __init__(self) -> None:
        self._stuck_ns: int | None = None  # when they were last stuck
        self.forget()

    def forget(self) -> None:
        """Begin another connection."""
        self._before: Sequence[int | None] | None = None
        self._were_zero = self._stuck = False

    @property
    def hindrance(self) -> str:
        return "" if self._stuck_ns is None else STUCK

    def look(self, positions: Sequence[int | None]) -> bool:
        """Return whether the joints of this cycle are stuck; a position is None if missing."""
        before, self._before = self._before, positions
        if not all(position in (0, 1) for position in positions):
            self._were_zero = self._stuck = False
        elif not self._were_zero:
            self._were_zero = True
            self._stuck = before is None or any(map(_is_far, before, positions))
        return self._stuck

    def events(self, now_ns: int) -> list[Event]:
        """Return the events of the last `look`."""
        was_stuck = self._stuck_ns is not None
        if self._stuck:
            self._stuck_ns = now_ns
            return [] if was_stuck else [Event("servos_stuck", STUCK, now_ns, "error")]
        if self._stuck_ns is None or now_ns - self._stuck_ns < GOOD_FOR_NS:
            return []
        self._stuck_ns = None
        text = "the servos' positions are no longer all 0"
        return [Event("servos_valid", text, now_ns, "info")]


def _is_far(before: int | None, now: int | None) -> bool:
    if before is None or now is None:
        return True
    half = COUNTS_PER_TURN // 2
    return abs((now - before + half) % COUNTS_PER_TURN - half) > FAR_COUNTS

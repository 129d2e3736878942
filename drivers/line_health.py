"""Is the line alive: one event for each loss and each recovery, whatever the wire."""

from __future__ import annotations

import time

import numpy as np

from armd.drivers.sample import Event, Item

STALE_NS = 50_000_000
SILENCE_NS = 500_000_000
BACK_OFF_FIRST_NS, BACK_OFF_MOST_NS = 20_000_000, 200_000_000


class LineHealth:
    """Knows since when the arm is not heard, and what is the matter if something is.

    Silence is reported after 0.5 s; as long as it lasts, the line is to be opened afresh every
    *renew_ns*. Attempts to open it back off, shortly: recovery has a second to happen.
    """

    def __init__(self, name: str, renew_ns: int) -> None:
        self._name = name
        self._renew_ns = renew_ns
        self._trouble: tuple[str, int] | None = None  # what, since when
        self._quiet_since_ns = time.monotonic_ns()
        self._back_off_ns = BACK_OFF_FIRST_NS
        self._times_opened = 0
        self.open_due_ns = 0  # when to try to open the line next

    @property
    def reconnects(self) -> int:
        return max(0, self._times_opened - 1)

    @property
    def act_ns(self) -> int:
        """When to report the silence, or to open a line afresh that is known to be silent."""
        return self._quiet_since_ns + (self._renew_ns if self._trouble else SILENCE_NS)

    def opened(self, now_ns: int) -> None:
        self._times_opened += 1
        self._quiet_since_ns = now_ns
        self._back_off_ns = BACK_OFF_FIRST_NS

    def lost(self, kind: str, text: str, now_ns: int) -> list[Item]:
        """The line is gone or silent: an event, unless it is known; the next attempt backs off."""
        self.open_due_ns = now_ns + self._back_off_ns
        self._back_off_ns = min(2 * self._back_off_ns, BACK_OFF_MOST_NS)
        if self._trouble is not None:
            return []
        self._trouble = (kind, now_ns)
        return [Event(kind, text, now_ns, "error", {"line": self._name})]

    def silent(self, now_ns: int, detail: str = "") -> list[Item]:
        """Nothing for too long: an event, unless it is known, with *detail* that is to be said;
        open the line afresh at once."""
        events = self.lost("silence", f"nothing heard for 0.5 s on {self._name}{detail}", now_ns)
        self.open_due_ns = now_ns
        return events

    def heard(self, at_ns: int | None, items: list[Item]) -> list[Item]:
        """*items*, with a word on the recovery before the first samples after a loss.

        *at_ns*: when the arm was last heard, whether or not that was delivered.
        """
        if at_ns is not None:
            self._quiet_since_ns = max(self._quiet_since_ns, at_ns)
        if self._trouble is None:
            return items
        first = next((i for i, item in enumerate(items) if isinstance(item, np.ndarray)), None)
        if first is None:
            return items
        (kind, since_ns), self._trouble = self._trouble, None
        now_ns = time.monotonic_ns()
        seconds = (now_ns - since_ns) / 1e9
        text = f"samples again on {self._name}, {seconds:.2f} s after its loss ({kind})"
        detail = {"line": self._name, "fault": kind, "seconds": seconds}
        return [*items[:first], Event("recovered", text, now_ns, "info", detail), *items[first:]]

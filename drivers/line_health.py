"""Watches whether a line is alive: one event for each loss and each recovery, on any wire."""

from __future__ import annotations

import time

import numpy as np

from armd.drivers.sample import Event, Item

STALE_NS = 50_000_000
SILENCE_NS = 500_000_000
BACK_OFF_FIRST_NS, BACK_OFF_MOST_NS = 20_000_000, 200_000_000


class LineHealth:
    """Knows since when the arm has been silent, and the present fault, if there is one.

    Silence is reported after 0.5 s. While it lasts, the line should be reopened every *renew_ns*.
    The attempts to open it back off up to 0.2 s, because recovery may take at most a second.
    """

    def __init__(self, name: str, renew_ns: int) -> None:
        self._name = name
        self._renew_ns = renew_ns
        self._trouble: tuple[str, int] | None = None  # kind of fault, its beginning
        self._quiet_since_ns = time.monotonic_ns()
        self._back_off_ns = BACK_OFF_FIRST_NS
        self._times_opened = 0
        self.open_due_ns = 0  # the next attempt to open the line

    @property
    def reconnects(self) -> int:
        return max(0, self._times_opened - 1)

    @property
    def act_ns(self) -> int:
        """The time to report the silence, or to reopen a line that is known to be silent."""
        return self._quiet_since_ns + (self._renew_ns if self._trouble else SILENCE_NS)

    def opened(self, now_ns: int) -> None:
        self._times_opened += 1
        self._quiet_since_ns = now_ns
        self._back_off_ns = BACK_OFF_FIRST_NS

    def lost(self, kind: str, text: str, now_ns: int) -> list[Item]:
        """Record that the line is gone or silent, and delay the next attempt to open it.

        Returns an event, unless a fault is known already.
        """
        self.open_due_ns = now_ns + self._back_off_ns
        self._back_off_ns = min(2 * self._back_off_ns, BACK_OFF_MOST_NS)
        if self._trouble is not None:
            return []
        self._trouble = (kind, now_ns)
        return [Event(kind, text, now_ns, "error", {"line": self._name})]

    def silent(self, now_ns: int, detail: str = "") -> list[Item]:
        """Record silence, and let the line be reopened at once.

        Returns an event with *detail*, unless a fault is known already.
        """
        events = self.lost("silence", f"nothing heard for 0.5 s on {self._name}{detail}", now_ns)
        self.open_due_ns = now_ns
        return events

    def heard(self, at_ns: int | None, items: list[Item]) -> list[Item]:
        """Return *items*, with an event of the recovery before the first samples after a loss.

        *at_ns*: when the arm last sent something, even if that was not delivered.
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

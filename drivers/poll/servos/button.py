"""A servo that serves as a button: pressed or not, and whether it answers."""

from __future__ import annotations

from collections.abc import Mapping

from armd.drivers.config import Trigger
from armd.drivers.sample import Event

MISSING_AFTER_NS = 500_000_000


class Button:
    """The button of one line; without a trigger it is never pressed."""

    def __init__(self, trigger: Trigger | None, name: str) -> None:
        """Take the *trigger*, and the *name* of the servo for messages."""
        self._trigger = trigger
        self._name = name
        self._heard_ns: int | None = None
        self._missing = False

    def look(self, positions: Mapping[int, int], now_ns: int) -> tuple[bool | None, list[Event]]:
        """Return whether it is pressed, None without an answer, and events.

        *positions*: those of a cycle, by servo id.
        """
        trigger = self._trigger
        if trigger is None:
            return None, []
        if self._heard_ns is None:
            self._heard_ns = now_ns
        if trigger.id in positions:
            self._heard_ns = now_ns
            pressed = positions[trigger.id] % 4096 < trigger.pressed_below
            return pressed, self._turn(False, now_ns)
        return None, self._turn(now_ns - self._heard_ns > MISSING_AFTER_NS, now_ns)

    def _turn(self, missing: bool, now_ns: int) -> list[Event]:
        if missing == self._missing:
            return []
        self._missing = missing
        assert self._trigger is not None
        detail = {"servo": self._trigger.id}
        if missing:
            text = f"{self._name}, the trigger, does not answer: no press is seen"
            return [Event("trigger_missing", text, now_ns, "error", detail)]
        text = f"{self._name}, the trigger, answers again"
        return [Event("trigger_back", text, now_ns, "info", detail)]

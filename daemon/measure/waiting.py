"""Remind a person who waits that no press or rest has come for a time."""

from __future__ import annotations

import time
from collections.abc import Callable

PATIENCE_S = 20.0
TEXTS = {
    "button": (
        "no press for {s:.0f} s: press the arm's button while the tip rests; an arm without one"
        ' (as of servos) takes readings at rests: [measurement] trigger = "rest" in armd.toml'
    ),
    "rest": (
        "no rest for {s:.0f} s: move the tip away and back, then hold it still for a second"
    ),
}  # fmt: skip


class Waiting:
    """The wait for a press or a rest; call `take_reminder` repeatedly."""

    def __init__(self, trigger: str, clock_s: Callable[[], float] = time.monotonic) -> None:
        """Begin a wait; *trigger* is "button" or "rest"."""
        self._text = TEXTS.get(trigger, TEXTS["button"]).format(s=PATIENCE_S)
        self._clock_s = clock_s
        self.restart()

    def restart(self) -> None:
        """End the wait, because the press or rest has come, and begin the next one."""
        self._since_s = self._clock_s()
        self._is_reminded = False

    def take_reminder(self) -> str:
        """Return the reminder that is due, once in a wait; "" for none."""
        if self._is_reminded or self._clock_s() - self._since_s < PATIENCE_S:
            return ""
        self._is_reminded = True
        return self._text

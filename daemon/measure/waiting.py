"""A person who waits is told what for: nothing was pressed for so long."""

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
    """Ask `due` again and again."""

    def __init__(self, trigger: str, clock_s: Callable[[], float] = time.monotonic) -> None:
        """*trigger*: "button" or "rest", whichever is waited for."""
        self._text = TEXTS.get(trigger, TEXTS["button"]).format(s=PATIENCE_S)
        self._clock_s = clock_s
        self.over()

    def over(self) -> None:
        """What was waited for has come; the next wait begins."""
        self._since_s = self._clock_s()
        self._is_reminded = False

    def take_reminder(self) -> str:
        """What is to be said now, once a wait; "" for nothing."""
        if self._is_reminded or self._clock_s() - self._since_s < PATIENCE_S:
            return ""
        self._is_reminded = True
        return self._text

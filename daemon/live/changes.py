"""Reloads and changes of tip while the arm measures: prepared aside, taken between two samples.

To read, check and build a calibration of thousands of terms takes a second, and a file may hang on
a network drive: a thread does that, one change after the other. Whatever is wrong with a file, the
calibration in force stays.
"""

from __future__ import annotations

import queue
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

from armd.daemon.live.arm_in_use import ArmInUse, Change
from armd.errors import ArmdError

#: Whoever asks while so many changes wait is refused; the same change asked for twice is one.
MOST_WAITING = 8

Answer = Callable[[str, bool], None]
"""Told what was done, and True; or why it was not, and False."""


class Tell(Protocol):
    """Publishes an event now."""

    def __call__(
        self, kind: str, text: str, severity: str, detail: dict[str, Any] | None = None
    ) -> None: ...


@dataclass
class _Asked:
    """For a reload (tip None) or a tip ("" is the calibration's own)."""

    tip: str | None
    answers: list[Answer] = field(default_factory=list)


class Changes:
    """`reload`, `select_tip` and `take` are the measuring thread's; they never wait."""

    def __init__(self, arm: ArmInUse, tell: Tell) -> None:
        self._arm = arm
        self._tell = tell
        self._waiting: deque[_Asked] = deque()
        self._under_way: _Asked | None = None
        self._jobs: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._ready: queue.SimpleQueue[Change | ArmdError] = queue.SimpleQueue()
        threading.Thread(target=self._prepare, name="changes", daemon=True).start()

    def reload(self, answer: Answer) -> None:
        """Read the calibration file again."""
        self._ask(None, answer)

    def select_tip(self, name: str, answer: Answer) -> None:
        """Measure with a tip of [tips]; "" is the calibration's own."""
        self._ask(name, answer)

    def take(self) -> None:
        """Between two samples: take over what is ready, begin what waits."""
        if self._under_way is not None:
            try:
                result = self._ready.get_nowait()
            except queue.Empty:
                return
            asked, self._under_way = self._under_way, None
            self._conclude(asked, result)
        if self._waiting:
            self._under_way = self._waiting.popleft()
            self._jobs.put(self._under_way.tip)

    def _ask(self, tip: str | None, answer: Answer) -> None:
        for asked in self._waiting:
            if asked.tip == tip:
                asked.answers.append(answer)
                return
        if len(self._waiting) >= MOST_WAITING:
            answer("refused: too many changes are waiting", False)
            return
        self._waiting.append(_Asked(tip, [answer]))

    def _prepare(self) -> None:
        """The thread."""
        while True:
            tip = self._jobs.get()
            try:
                self._ready.put(self._arm.reloaded() if tip is None else self._arm.with_tip(tip))
            except ArmdError as error:
                self._ready.put(error)
            except Exception as error:  # nothing that is wrong with a file may end this thread
                self._ready.put(ArmdError(f"{type(error).__name__}: {error}"))

    def _conclude(self, asked: _Asked, result: Change | ArmdError) -> None:
        if isinstance(result, ArmdError):
            text, done = str(result), False
            if asked.tip is None:
                self._tell("calibration_refused", f"{text}; the old one stays", "error")
        else:
            self._arm.take(result)
            text, done = self._say(asked.tip), True
            if result.warning is not None:
                self._tell("tip_moved", result.warning, "warning")
        for answer in asked.answers:
            answer(text, done)

    def _say(self, tip: str | None) -> str:
        calibration = self._arm.calibration
        if tip is not None:
            text = f"tip {tip}" if tip else "the calibration's tip"
            self._tell("tip", f"now measuring with {text}", "info", {"tip": self._arm.tip})
        else:
            sha256 = None if calibration is None else calibration.sha256
            text = "nominal geometry" if sha256 is None else f"calibration {sha256}"
            self._tell("calibration", f"now correcting with {text}", "info")
        return text

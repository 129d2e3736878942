"""Reload calibrations and change tips while the arm measures.

To read, check and build a calibration of thousands of terms takes a second, and a file may be on a
network drive that hangs. So a thread prepares changes, one after another, and they take effect
between two samples. If a file is faulty, the active calibration stays.
"""

from __future__ import annotations

import queue
import threading
from collections import deque
from dataclasses import dataclass, field
from typing import Any, Protocol

from armd.daemon.config import Tip
from armd.daemon.live.answer import Respond
from armd.daemon.live.arm_in_use import ArmInUse, Takeover
from armd.errors import ArmdError

#: Limit of waiting changes; further requests are refused, but equal requests are one change.
MOST_WAITING = 8


class Tell(Protocol):
    """A function that publishes an event at once."""

    def __call__(
        self, kind: str, text: str, severity: str, detail: dict[str, Any] | None = None
    ) -> None: ...


@dataclass
class _Request:
    """A request: a reload (tip None), a tip ("" is the calibration's own), or a new tip."""

    tip: str | None
    calibrated: Tip | None = None
    answers: list[Respond] = field(default_factory=list)


class Changes:
    """Takes requests of the measuring thread, which never waits for them."""

    def __init__(self, arm: ArmInUse, tell: Tell) -> None:
        self._arm = arm
        self._tell = tell
        self._waiting: deque[_Request] = deque()
        self._under_way: _Request | None = None
        self._jobs: queue.SimpleQueue[_Request] = queue.SimpleQueue()
        self._ready: queue.SimpleQueue[Takeover | ArmdError] = queue.SimpleQueue()
        threading.Thread(target=self._prepare, name="changes", daemon=True).start()

    def reload(self, answer: Respond) -> None:
        """Ask for the calibration file to be read again."""
        self._ask(_Request(None), answer)

    def select_tip(self, name: str, answer: Respond) -> None:
        """Ask for one of the tips; "" is the calibration's own."""
        self._ask(_Request(name), answer)

    def keep_tip(self, name: str, tip: Tip, answer: Respond) -> None:
        """Ask for a tip that was calibrated now, for use now and after every restart."""
        self._ask(_Request(name, tip), answer)

    def take(self) -> None:
        """Use a change that is ready, and start a waiting one; called between two samples."""
        if self._under_way is not None:
            try:
                result = self._ready.get_nowait()
            except queue.Empty:
                return
            request, self._under_way = self._under_way, None
            self._conclude(request, result)
        if self._waiting:
            self._under_way = self._waiting.popleft()
            self._jobs.put(self._under_way)

    def _ask(self, new: _Request, answer: Respond) -> None:
        for request in self._waiting:
            if (request.tip, request.calibrated) == (new.tip, new.calibrated):
                request.answers.append(answer)
                return
        if len(self._waiting) >= MOST_WAITING:
            answer("refused: too many changes are waiting", False)
            return
        new.answers.append(answer)
        self._waiting.append(new)

    def _prepare(self) -> None:
        """Prepare changes for ever, in the thread."""
        while True:
            request = self._jobs.get()
            try:
                self._ready.put(self._prepared(request))
            except ArmdError as error:
                self._ready.put(error)
            except Exception as error:  # a faulty file must not end this thread
                self._ready.put(ArmdError(f"{type(error).__name__}: {error}"))

    def _prepared(self, request: _Request) -> Takeover:
        if request.tip is None:
            return self._arm.prepare_calibration_again()
        if request.calibrated is None:
            return self._arm.prepare_tip(request.tip)
        return self._arm.store_and_prepare_tip(request.tip, request.calibrated)

    def _conclude(self, request: _Request, result: Takeover | ArmdError) -> None:
        if isinstance(result, ArmdError):
            text, done = str(result), False
            if request.tip is None:
                self._tell("calibration_refused", f"{text}; the old one stays", "error")
        else:
            self._arm.take(result)
            text, done = self._announce(request), True
            if result.warning is not None:
                self._tell("tip_moved", result.warning, "warning")
        for answer in request.answers:
            answer(text, done)

    def _announce(self, request: _Request) -> str:
        calibration, tip = self._arm.calibration, request.tip
        if tip is not None:
            text = f"tip {tip}" if tip else "the calibration's tip"
            text += ", as it was calibrated now" if request.calibrated is not None else ""
            detail = {"tip": self._arm.tip, **self._arm.tip_in_use.model_dump(mode="json")}
            self._tell("tip", f"now measuring with {text}", "info", detail)
        else:
            sha256 = None if calibration is None else calibration.sha256
            text = "nominal geometry" if sha256 is None else f"calibration {sha256}"
            self._tell("calibration", f"now correcting with {text}", "info")
        return text

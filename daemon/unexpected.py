"""Log, count and survive unexpected exceptions outside the stream."""

from __future__ import annotations

import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import contextmanager

from armd.drivers.sample import Event

_log = logging.getLogger(__name__)
EVENTS_KEPT = 16


class Unexpected:
    """The unexpected exceptions of one daemon; any of its threads may use it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counted: Counter[str] = Counter()
        self._noted: set[tuple[str, str]] = set()
        self._events: deque[Event] = deque(maxlen=EVENTS_KEPT)

    @contextmanager
    def survive(self, place: str) -> Iterator[None]:
        """Catch and note any exception within this `with`, so that only its body ends."""
        try:
            yield
        except Exception as error:
            self._note(place, error)

    def as_json(self) -> dict[str, int]:
        """Return the number of exceptions since the start, by place."""
        with self._lock:
            return dict(self._counted)

    def take_events(self) -> list[Event]:
        """Return the new events: one for each kind of exception at each place."""
        with self._lock:
            events = list(self._events)
            self._events.clear()
        return events

    def _note(self, place: str, error: Exception) -> None:
        kind = type(error).__name__
        text = f"{place}: {kind}: {' '.join(str(error).split())[:200]}"
        with self._lock:
            self._counted[place] += 1
            if (place, kind) in self._noted:
                return
            self._noted.add((place, kind))
            text += "; this is a fault of armd, which goes on: please report it"
            detail = {"where": place, "error": kind}
            now_ns = time.monotonic_ns()
            self._events.append(Event("unexpected", text, now_ns, "error", detail))
        _log.error("%s", text, exc_info=error)

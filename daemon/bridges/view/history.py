"""The temperatures of the last hour, for a newly opened page."""

from __future__ import annotations

import json
from collections import deque
from typing import Any

EVERY_MS = 2000.0
KEPT_MS = 3_600_000.0


class TemperatureHistory:
    """A history with a row every two seconds, for an hour."""

    def __init__(self) -> None:
        self._sensors: list[str] = []
        self._rows: deque[list[float | None]] = deque()

    def add(self, health: dict[str, Any]) -> None:
        """Add the temperatures of one health message."""
        ms = health["stamp_ns"] / 1e6
        sensors = list(health["temperatures"])
        if sensors != self._sensors or (self._rows and ms < (self._rows[-1][0] or 0.0)):
            self._sensors = sensors  # another arm's file, or the clock was set back
            self._rows.clear()
        if not self._rows or ms - (self._rows[-1][0] or 0.0) >= EVERY_MS * 0.9:
            self._rows.append([ms, *health["temperatures"].values()])
        while ms - (self._rows[0][0] or 0.0) > KEPT_MS:
            self._rows.popleft()

    def text(self) -> str:
        """Return JSON: `sensors`, and `rows` of Unix ms and °C in their order.

        A missing temperature is null.
        """
        return json.dumps({"sensors": self._sensors, "rows": list(self._rows)})

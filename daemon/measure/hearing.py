"""Detect that the arm is silent during a measurement, and recover missed presses.

A connection can be lost for a while, or the daemon restarts. A press is then published without a
receiver. The daemon keeps its last measurements, and is asked for them afterwards.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from armd import keys
from armd.client import Arm

SILENT_S = 5.0  # health comes each second


class Hearing:
    """The state of the connection to the arm; call `changed` repeatedly."""

    def __init__(self, arm: Arm, clock_s: Callable[[], float] = time.monotonic) -> None:
        """Note all past measurements, which are never readings of this session."""
        self._arm = arm
        self._clock_s = clock_s
        self._heard_s = clock_s()
        self._heard = {_get_identity(measurement) for measurement in arm.past(keys.MEASUREMENT)}
        self.silent = False

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Note the arm's health messages within this `with`."""
        with self._arm.calling(keys.HEALTH, self._note):
            yield

    def _note(self, _: bytes) -> None:
        self._heard_s = self._clock_s()

    def changed(self) -> bool:
        """Return whether the arm became silent, or is received again, since the last call."""
        before, self.silent = self.silent, self._clock_s() - self._heard_s > SILENT_S
        return self.silent != before

    def is_known(self, measurement: Mapping[str, Any]) -> bool:
        """Return whether the measurement was among `missed`; it may also arrive a moment later."""
        return _get_identity(measurement) in self._heard

    def note_received(self, measurement: Mapping[str, Any]) -> None:
        """Note a measurement that was received, so that it is not missed."""
        self._heard.add(_get_identity(measurement))

    def missed(self) -> list[dict[str, Any]]:
        """Return measurements since the beginning that were not received, the oldest first."""
        past = self._arm.past(keys.MEASUREMENT)
        missed = [measurement for measurement in past if not self.is_known(measurement)]
        self._heard.update(map(_get_identity, missed))
        return missed


def _get_identity(measurement: Mapping[str, Any]) -> tuple[Any, Any]:
    return measurement.get("seq"), measurement.get("stamp_ns")

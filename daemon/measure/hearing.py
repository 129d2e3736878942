"""Whether the arm is heard while a person measures, and what was pressed while it was not.

A connection can be gone for a while, or the daemon starts anew. A press is then published and
nobody hears it; the daemon remembers its last measurements, and is asked for them afterwards.
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
    """Ask `changed` again and again."""

    def __init__(self, arm: Arm, clock_s: Callable[[], float] = time.monotonic) -> None:
        """Measurements of before are no readings of this session, whenever they are heard of."""
        self._arm = arm
        self._clock_s = clock_s
        self._heard_s = clock_s()
        self._heard = {_get_identity(measurement) for measurement in arm.past(keys.MEASUREMENT)}
        self.silent = False

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Within this `with` it is noted when the arm says how it is."""
        with self._arm.calling(keys.HEALTH, self._note):
            yield

    def _note(self, _: bytes) -> None:
        self._heard_s = self._clock_s()

    def changed(self) -> bool:
        """Whether the arm has fallen silent, or is heard again, since this was asked last."""
        before, self.silent = self.silent, self._clock_s() - self._heard_s > SILENT_S
        return self.silent != before

    def knows(self, measurement: Mapping[str, Any]) -> bool:
        """Whether it was among `missed`: it may be heard as well, a moment later."""
        return _get_identity(measurement) in self._heard

    def offered(self, measurement: Mapping[str, Any]) -> None:
        """It was heard, and is not missed."""
        self._heard.add(_get_identity(measurement))

    def missed(self) -> list[dict[str, Any]]:
        """What the arm has measured since the begin and nobody has heard, the oldest first."""
        past = self._arm.past(keys.MEASUREMENT)
        missed = [measurement for measurement in past if not self.knows(measurement)]
        self._heard.update(map(_get_identity, missed))
        return missed


def _get_identity(measurement: Mapping[str, Any]) -> tuple[Any, Any]:
    return measurement.get("seq"), measurement.get("stamp_ns")

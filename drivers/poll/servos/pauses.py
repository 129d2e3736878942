"""How long servos wait before they answer, as they told when they were identified."""

from __future__ import annotations

from collections.abc import Mapping

from armd.drivers.poll.protocol.family import Family, Servo
from armd.drivers.poll.protocol.packet import ReadRequest


class Pauses:
    """The pauses before the answers to a request, worked out once for servos that stay known."""

    def __init__(self, family: Family, servos: Mapping[int, Servo]) -> None:
        """*servos*: those identified, as they come and go."""
        self._least_us = family.return_delay_least_us
        self._servos = servos
        self._pauses_ns: dict[tuple[int, ...], list[float]] = {}  # by the servos asked
        self._version = -1  # of the servos that they are of

    def before_ns(self, request: ReadRequest, version: int) -> list[float]:
        """Before each answer to *request*, in the order in which these are asked for; *version*:
        of the servos, another one whenever they are others."""
        if request.fast:
            return [0.0] * len(request.ids)
        if self._version != version:
            self._pauses_ns.clear()
            self._version = version
        pauses_ns = self._pauses_ns.get(request.ids)
        if pauses_ns is None:
            identified = map(self._servos.get, request.ids)
            told_us = [0 if servo is None else servo.return_delay_us for servo in identified]
            pauses_ns = self._pauses_ns[request.ids] = [
                max(us, self._least_us) * 1e3 for us in told_us
            ]
        return pauses_ns

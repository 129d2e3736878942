"""The pauses of servos before they answer, from their registers."""

from __future__ import annotations

from collections.abc import Mapping

from armd.drivers.poll.protocol.family import Family, Servo
from armd.drivers.poll.protocol.packet import ReadRequest


class Pauses:
    """The pauses before the answers to a request, computed once while the servos stay the same."""

    def __init__(self, family: Family, servos: Mapping[int, Servo]) -> None:
        """Take the family, and the identified *servos*, a mapping that changes."""
        self._least_us = family.return_delay_least_us
        self._servos = servos
        self._pauses_ns: dict[tuple[int, ...], list[float]] = {}  # by the requested servos
        self._version = -1  # version of the servos that they belong to

    def before_ns(self, request: ReadRequest, version: int) -> list[float]:
        """Return the pause before each answer to *request*, in ns and in its order.

        *version*: of the servos; it changes whenever they do.
        """
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

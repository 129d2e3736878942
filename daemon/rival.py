"""Another daemon that publishes under the same serial number: told, as both arms' points mix."""

from __future__ import annotations

from typing import Any

import zenoh

from armd import keys
from armd.drivers.sample import Event

#: A rival speaks once a second; one that was silent for so long is told of anew.
SILENT_NS = 5_000_000_000


class Rival:
    """Hears health under this serial number that is not this daemon's own."""

    def __init__(self, session: zenoh.Session, serial: str) -> None:
        self._serial = serial
        self._subscriber: zenoh.Subscriber[Any] = session.declare_subscriber(
            keys.key(serial, keys.HEALTH),
            zenoh.handlers.RingChannel(1),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        self._heard_ns: int | None = None

    def look(self, now_ns: int) -> list[Event]:
        """Asked now and then: one event for each time that a rival shows up."""
        if self._subscriber.try_recv() is None:
            return []
        new = self._heard_ns is None or now_ns - self._heard_ns > SILENT_NS
        self._heard_ns = now_ns
        if not new:
            return []
        text = (
            f"another daemon publishes as {self._serial}: points of two arms arrive under one "
            "serial number; stop one of them"
        )
        return [Event("two_daemons", text, now_ns, "error")]

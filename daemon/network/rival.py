"""Another daemon that publishes under the same serial number: told, as both arms' points mix."""

from __future__ import annotations

from typing import Any

import zenoh

from armd import keys
from armd.drivers.sample import Event

#: How often a daemon says that it is there; a rival silent for so long is told of anew.
SPEAK_NS, SILENT_NS = 1_000_000_000, 5_000_000_000


class RivalWatch:
    """Says that this daemon is there, and hears whether another does under its serial number.

    On a key of its own: it is the one on which the daemon's session lets others speak
    (daemon/network/session.py), and whoever forges it gains an alarm.
    """

    def __init__(self, session: zenoh.Session, serial: str) -> None:
        self._serial = serial
        key = keys.key(serial, keys.DAEMON)
        self._publisher = session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.DROP
        )
        self._due_ns = 0
        self._subscriber: zenoh.Subscriber[Any] = session.declare_subscriber(
            key,
            zenoh.handlers.RingChannel(1),
            allowed_origin=zenoh.Locality.REMOTE,
        )
        self._heard_ns: int | None = None

    def look(self, now_ns: int) -> list[Event]:
        """Asked now and then: one event for each time that a rival shows up."""
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + SPEAK_NS
            self._publisher.put(b"")
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

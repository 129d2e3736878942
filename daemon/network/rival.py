"""Detect another daemon with the same serial number, because both arms' points mix."""

from __future__ import annotations

from typing import Any

import zenoh

from armd import keys
from armd.drivers.sample import Event

#: Period of a daemon's sign of life; a rival that was silent for the longer time is reported again.
SPEAK_NS, SILENT_NS = 1_000_000_000, 5_000_000_000


class RivalWatch:
    """Publishes this daemon's sign of life, and detects another under its serial number.

    It uses a separate key, the only one on which the daemon's session accepts data from others
    (daemon/network/session.py). A client that forges it can only cause this alarm.
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
        """Return an event each time that a rival appears; call it now and then."""
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

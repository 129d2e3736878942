"""All arms that can be reached at one endpoint, by their tokens and their health."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import zenoh

from armd import keys
from armd.daemon.state import State
from armd.received import parse_object

#: Health comes once a second. A frozen daemon keeps its token for four seconds.
SILENT_S = 3.0
EVENTS_KEPT = 50


class Fleet:
    """The latest token, health and events of each arm, without any network code.

    Zenoh's threads write to it.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self._alive: set[str] = set()
        self._health: dict[str, tuple[dict[str, Any], float]] = {}
        self._malformed: Counter[str] = Counter()
        self.events: deque[tuple[str, str]] = deque(maxlen=EVENTS_KEPT)
        """Serial and text of what went wrong, or of one serial with two daemons."""

    def note_token(self, serial: str, alive: bool) -> None:
        with self._lock:
            if alive:
                self._alive.add(serial)
            else:
                self._alive.discard(serial)
                self._health.pop(serial, None)

    def note_health(self, serial: str, health: dict[str, Any]) -> None:
        with self._lock:
            self._health[serial] = health, self._clock()

    def note_event(self, serial: str, event: dict[str, Any]) -> None:
        if event.get("severity") in ("warning", "error"):
            self.events.append((serial, event["text"]))

    def note_malformed(self, serial: str) -> None:
        """Count a dropped message that is not armd's; report the first of each arm."""
        self._malformed[serial] += 1
        if self._malformed[serial] == 1:
            self.events.append(
                (serial, "drops messages that are not armd's: who else writes here?")
            )

    def healths(self) -> list[dict[str, Any]]:
        """Return the last health message of each arm that is alive, by serial number."""
        with self._lock:
            serials = sorted(self._alive & self._health.keys())
            # The serial is the key's, not the message's: two arms of one name stay two metrics.
            return [self._health[serial][0] | {"serial": serial} for serial in serials]

    def rows(self) -> list[dict[str, Any]]:
        """Return a row for each arm that is alive and has sent its health."""
        now_s = self._clock()
        with self._lock:
            serials = sorted(self._alive & self._health.keys())
            return [_row(serial, *self._health[serial], now_s) for serial in serials]


def _row(serial: str, health: dict[str, Any], heard_s: float, now_s: float) -> dict[str, Any]:
    silent = now_s - heard_s > SILENT_S
    return {
        "serial": serial,
        "state": State.NOT_READY if silent else health["state"],
        "reason": "its daemon is silent" if silent else health["reason"],
        "points_hz": 0.0 if silent else health["rates"]["points_hz"],
        "lost": health["drops"].get("lost", 0),
        "temperatures": health["temperatures"],
        "calibration": health["calibration"],
        "tip": health["tip"],
        "stamp_ns": health["stamp_ns"],
    }


class Listening:
    """Feeds a fleet from a session, from construction to `close`."""

    def __init__(self, session: zenoh.Session, fleet: Fleet, serial: str | None) -> None:
        """Subscribe to one arm; *serial* None: to all of them."""
        name = serial or "*"

        def token(sample: zenoh.Sample) -> None:
            fleet.note_token(_serial(sample), sample.kind == zenoh.SampleKind.PUT)

        def health(sample: zenoh.Sample) -> None:
            message = parse_object(keys.HEALTH, sample.payload.to_bytes())
            if message is None:
                fleet.note_malformed(_serial(sample))
            else:
                fleet.note_health(_serial(sample), message)

        def event(sample: zenoh.Sample) -> None:
            message = parse_object(keys.EVENT, sample.payload.to_bytes())
            if message is None:
                fleet.note_malformed(_serial(sample))
            else:
                fleet.note_event(_serial(sample), message)

        # Ask now, so that nobody waits for the next message of each arm.
        for reply in session.get(keys.key(name, keys.HEALTH)):
            if reply.ok is not None:
                health(reply.ok)
        self._subscribers = [
            session.declare_subscriber(keys.key(name, keys.HEALTH), health),
            session.declare_subscriber(keys.key(name, keys.EVENT), event),
            session.liveliness().declare_subscriber(
                keys.key(name, keys.ALIVE), token, history=True
            ),
        ]

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.undeclare()  # type: ignore[no-untyped-call]


def _serial(sample: zenoh.Sample) -> str:
    return str(sample.key_expr).split("/")[1]


async def show_repeatedly(
    fleet: Fleet, show: Callable[[Fleet], None], every_s: float, seconds: float | None
) -> None:
    """Call *show* every *every_s* seconds, until *seconds* are over or for ever."""
    start_s = next_s = time.monotonic()
    while seconds is None or next_s - start_s < seconds:
        next_s += every_s
        await asyncio.sleep(max(0.0, next_s - time.monotonic()))
        show(fleet)

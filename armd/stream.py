"""One subscription to an arm: waiting payloads, and loops that end when the arm is closed."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import zenoh
from zenoh import ext

from armd import keys
from armd.closing import Closing
from armd.errors import Closed
from armd.received import Gate
from armd.zenoh_session import convert_errors

#: The most messages that wait for a reader; then the oldest are dropped, and points count as lost.
WAITING_POINTS = 1 << 14
WAITING_MESSAGES = 1024
POLL_S = 0.002

#: A daemon answers in a fraction of a millisecond; an absent one costs this delay.
SETTLED_S = 1.0


class Handle(Closing):
    """The result of `Arm.on_measurement` and `Arm.on_event`: `close()` ends the calls."""

    def __init__(self, close: Callable[[], object]) -> None:
        self._close = close

    def close(self) -> None:
        with suppress(zenoh.ZError):  # the arm was closed first
            self._close()


class Stream(Closing):
    """One subscription; a reader that is slow delays nobody else.

    Payloads that wait too long are dropped here, the oldest first. Payloads that *gate* refuses are
    skipped.
    """

    def __init__(
        self,
        session: zenoh.Session,
        serial: str,
        topic_key: str,
        gate: Gate,
        waiting: int | None = None,
        past: bool = True,
    ) -> None:
        """Subscribe; *past*: events and measurements that the daemon still has come first."""
        self._key = keys.key(serial, topic_key)
        self._topic_key = topic_key
        self._gate = gate
        self._session = session
        if waiting is None or topic_key in (keys.EVENT, keys.MEASUREMENT):
            waiting = WAITING_POINTS if topic_key in (keys.POINT, keys.RAW) else WAITING_MESSAGES
        channel: Any = zenoh.handlers.RingChannel(waiting)
        past = past and topic_key in (keys.EVENT, keys.MEASUREMENT)
        self._subscriber = subscribe(session, self._key, channel, past)
        if topic_key in (keys.POINT, keys.RAW, keys.JOINTS):
            self._pass_over_leftovers(serial)

    def _pass_over_leftovers(self, serial: str) -> None:
        """Drop samples of this session's last subscription to the same key.

        The daemon sends until it learns that the last subscription ended, and again when it learns
        of this one. It sends nothing between the two, so an earlier sample would begin a stream
        with a gap. The daemon answers a query only after it has processed both.
        """
        with convert_errors(self._session, self._key):
            for _ in self._session.get(keys.key(serial, keys.HEALTH), timeout=SETTLED_S):
                pass
            while self._subscriber.try_recv() is not None:
                pass

    def close(self) -> None:
        with suppress(zenoh.ZError):  # the arm was closed first
            self._subscriber.undeclare()

    def take(self) -> list[bytes]:
        """Return the waiting payloads, maybe none; raises `Closed` once the arm is closed."""
        payloads = []
        with convert_errors(self._session, self._key):
            while (sample := self._subscriber.try_recv()) is not None:
                payload = self._gate.payload(self._topic_key, sample)
                if payload is not None:
                    payloads.append(payload)
        return payloads

    def follow(self, seconds: float | None) -> Iterator[list[bytes]]:
        """Yield all waiting payloads repeatedly, for ever or for *seconds*; ends with the arm."""
        end_s = math.inf if seconds is None else time.monotonic() + seconds
        with suppress(Closed):
            while seconds is None:
                with convert_errors(self._session, self._key):
                    sample = self._subscriber.recv()
                first = self._gate.payload(self._topic_key, sample)
                waiting = self.take()
                payloads = waiting if first is None else [first, *waiting]
                if payloads:
                    yield payloads
            while time.monotonic() < end_s:
                if payloads := self.take():
                    yield payloads
                else:
                    time.sleep(POLL_S)


def subscribe(session: zenoh.Session, key: str, handler: Any, past: bool) -> Any:
    """Subscribe to *key*; with *past*, the messages that its publisher keeps come first."""
    with convert_errors(session, key):
        if not past:
            return session.declare_subscriber(key, handler)
        history = ext.HistoryConfig(detect_late_publishers=True)
        return ext.declare_advanced_subscriber(session, key, handler, history=history)

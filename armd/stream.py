"""One subscription to an arm: payloads that wait, and loops that end when the arm is closed."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any, TypeVar

import zenoh
from zenoh import ext

from armd import keys
from armd.closing import Closing
from armd.errors import ArmdError
from armd.received import Gate

#: What waits for a slow reader; beyond that the oldest goes, and points count as lost.
WAITING_POINTS = 1 << 14
WAITING_MESSAGES = 1024
POLL_S = 0.002

T = TypeVar("T")
#: A daemon that answers does so in a fraction of a millisecond; one that is away delays this long.
SETTLED_S = 1.0


class Closed(ArmdError):
    """The arm was closed, by this program."""


class Handle(Closing):
    """What `Arm.on_measurement` and `Arm.on_event` return: `close()` ends the calls."""

    def __init__(self, close: Callable[[], object]) -> None:
        self._close = close

    def close(self) -> None:
        with suppress(zenoh.ZError):  # the arm was closed before it
            self._close()


class Stream(Closing):
    """One subscription. A reader that stands still delays nobody else: what waits too long is
    dropped here, the oldest first. What *gate* does not let through is passed over."""

    def __init__(
        self,
        session: zenoh.Session,
        serial: str,
        what: str,
        gate: Gate,
        waiting: int | None = None,
    ) -> None:
        key = keys.key(serial, what)
        self._what = what
        self._gate = gate
        self._subscriber: zenoh.Subscriber[Any] | ext.AdvancedSubscriber[Any]
        if what in (keys.EVENT, keys.MEASUREMENT):
            self._subscriber = ext.declare_advanced_subscriber(
                session,
                key,
                zenoh.handlers.RingChannel(WAITING_MESSAGES),
                history=ext.HistoryConfig(detect_late_publishers=True),
            )
        else:
            if waiting is None:
                waiting = WAITING_POINTS if what in (keys.POINT, keys.RAW) else WAITING_MESSAGES
            self._subscriber = session.declare_subscriber(key, zenoh.handlers.RingChannel(waiting))
            if what in (keys.POINT, keys.RAW, keys.JOINTS):
                self._pass_over_leftovers(session, serial)

    def _pass_over_leftovers(self, session: zenoh.Session, serial: str) -> None:
        """Drop what may come of this session's last subscription to the same key.

        The daemon sends on until it hears that the last one ended, and again once it hears of this
        one: between the two it sends nothing, and a sample of before would begin a stream with a
        hole. What the daemon is asked after both, it answers after both.
        """
        for _ in session.get(keys.key(serial, keys.HEALTH), timeout=SETTLED_S):
            pass
        while self._subscriber.try_recv() is not None:
            pass

    def close(self) -> None:
        with suppress(zenoh.ZError):  # the arm was closed before it
            self._subscriber.undeclare()  # type: ignore[no-untyped-call]

    def take(self) -> list[bytes]:
        """The payloads that wait, maybe none; raises `ArmdError` once the arm is closed."""
        payloads = []
        while (sample := self._receive(self._subscriber.try_recv)) is not None:
            payload = self._gate.payload(self._what, sample)
            if payload is not None:
                payloads.append(payload)
        return payloads

    def follow(self, seconds: float | None) -> Iterator[list[bytes]]:
        """All that waits, again and again, for ever or for *seconds*; ends with the arm."""
        end_s = math.inf if seconds is None else time.monotonic() + seconds
        with suppress(Closed):
            while seconds is None:
                sample = self._receive(self._subscriber.recv)
                first = self._gate.payload(self._what, sample)
                waiting = self.take()
                payloads = waiting if first is None else [first, *waiting]
                if payloads:
                    yield payloads
            while time.monotonic() < end_s:
                if payloads := self.take():
                    yield payloads
                else:
                    time.sleep(POLL_S)

    def _receive(self, receive: Callable[[], T]) -> T:
        """Raises `Closed` where Zenoh says that nothing can come any more."""
        try:
            return receive()
        except zenoh.ZError:
            raise Closed("the connection to the arm is closed") from None

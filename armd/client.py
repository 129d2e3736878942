"""A subscriber's view of an arm: connect, iterate points. Needs no configuration of armd.

with armd.connect() as arm:
    for point in arm.points():
        print(point.seq, point.position_mm)
"""

from __future__ import annotations

import asyncio
import base64
import json
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import numpy.typing as npt
import zenoh
from zenoh import ext

from armd import keys
from armd.closing import Closing
from armd.errors import ArmdError, NoAnswer, cut
from armd.point import POINT, Lost, Point
from armd.received import FORMS, Gate, Refused, json_object
from armd.stream import POLL_S, Closed, Handle, Stream
from armd.zenoh_session import ENDPOINT, find_arm, open_session


class Arm(Closing):
    """A connection to one arm's streams; close it, or use it in a `with`.

    Three kinds of calls: `points`, `batches`, `measurements`, `events` and `health` iterate over
    what comes, for ever or for *seconds*, and end when the arm is closed, by any thread; `latest`,
    `state`, `info` and `past` answer at once; `on_measurement` and `on_event` call a function.
    Iterate from one thread.
    """

    def __init__(self, session: zenoh.Session, serial: str) -> None:
        self._session = session
        self.serial = serial
        self.lost = Lost()
        self._gate = Gate()

    @property
    def refused(self) -> Refused:
        """What came on the arm's keys and was passed over: malformed, or of another publisher."""
        return self._gate.refused

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    def points(self, seconds: float | None = None) -> Iterator[Point]:
        """Every point from now on, in order."""
        for batch in self.batches(seconds):
            yield from Point.from_array(batch)

    def batches(self, seconds: float | None = None) -> Iterator[npt.NDArray[np.void]]:
        """Arrays of `armd.POINT`: whatever has come since the last one, at least one point.

        What passes between two iterations is not lost, only not asked for.
        """
        self.lost.begin()
        with self.stream(keys.POINT) as stream:
            for payloads in stream.follow(seconds):
                yield self.decode(payloads)

    def latest(self, timeout_s: float = 1.0) -> Point:
        """The next point that comes; raises `NoAnswer` if none does within *timeout_s*."""
        for point in self.points(timeout_s):
            return point
        raise NoAnswer(f"{self.serial}: no point within {timeout_s:g} s")

    def state(self) -> dict[str, Any]:
        """The last health message: state, reason, rates, temperatures. Raises `NoAnswer`."""
        return self._ask(keys.HEALTH)

    async def points_async(self) -> AsyncIterator[Point]:
        """Every point from now on, for `async for`; ends when the arm is closed."""
        self.lost.begin()
        with self.stream(keys.POINT) as stream, suppress(Closed):
            while True:
                for point in Point.from_array(self.decode(stream.take())):
                    yield point
                await asyncio.sleep(POLL_S)

    def on_measurement(
        self, call: Callable[[dict[str, Any]], object], past: bool = False
    ) -> Handle:
        """Call *call* with each measurement as it comes, in a thread of Zenoh's; with *past* first
        with those that the daemon still has. Close the handle that is returned to end it."""
        return self._on(keys.MEASUREMENT, call, past)

    def on_event(self, call: Callable[[dict[str, Any]], object], past: bool = False) -> Handle:
        """The same for events."""
        return self._on(keys.EVENT, call, past)

    def _on(self, what: str, call: Callable[[dict[str, Any]], object], past: bool) -> Handle:
        def pass_on(sample: zenoh.Sample) -> None:
            payload = self._gate.payload(what, sample)
            if payload is not None:
                call(json.loads(payload))

        key = keys.key(self.serial, what)
        subscriber: zenoh.Subscriber[Any] | ext.AdvancedSubscriber[Any]
        if past:
            history = ext.HistoryConfig(detect_late_publishers=True)
            subscriber = ext.declare_advanced_subscriber(
                self._session, key, pass_on, history=history
            )
        else:
            subscriber = self._session.declare_subscriber(key, pass_on)
        return Handle(subscriber.undeclare)

    def health(self, seconds: float | None = None) -> Iterator[dict[str, Any]]:
        """Once a second: state, reason, rates, drops, temperatures, latency."""
        return self._messages(keys.HEALTH, seconds)

    def events(self, seconds: float | None = None) -> Iterator[dict[str, Any]]:
        """Faults, recoveries, buttons, changes; those of the past first."""
        return self._messages(keys.EVENT, seconds)

    def measurements(self, seconds: float | None = None) -> Iterator[dict[str, Any]]:
        """Averaged points, one per button press or rest; those of the past first."""
        return self._messages(keys.MEASUREMENT, seconds)

    def health_now(self) -> dict[str, Any]:
        """The older name of `state`."""
        return self.state()

    def info(self) -> dict[str, Any]:
        """Arm, calibration, units, payload layout."""
        return self._ask(keys.INFO)

    def calibration_file(self) -> str | None:
        """The calibration file in use, byte for byte; None without one.

        Raises `ArmdError` for an answer that is no calibration.
        """
        data = self._ask_bytes(keys.CALIBRATION)
        if data == b"null":
            return None
        self._checked(keys.CALIBRATION, data)
        return data.decode()

    def past(self, what: str) -> list[dict[str, Any]]:
        """What the daemon still has of its measurements or events (`armd.keys`), the oldest
        first: the last thousand."""
        replies = self._session.get(
            keys.key(self.serial, what), consolidation=zenoh.ConsolidationMode.NONE
        )
        payloads = [reply.ok.payload.to_bytes() for reply in replies if reply.ok]
        messages = [json_object(what, payload) for payload in payloads]
        self._gate.refused.malformed += messages.count(None)
        return [message for message in messages if message is not None]

    def preamble(self) -> tuple[int, list[bytes]]:
        """For a recorder of raw frames: the number of the next one, and the frames, as published,
        that a decoder must be fed before it."""
        reply = self._ask(keys.RAW)
        try:
            return int(reply["next"]), [base64.b64decode(frame) for frame in reply["frames"]]
        except (KeyError, TypeError, ValueError) as error:
            raise ArmdError(f"{keys.RAW}: the answer is none of armd's: {error!r}") from error

    def command(self, name: str, /, **parameters: str) -> str:
        """`command("reload")`, `command("tip", name="ruby 3")`; returns what was done.

        Raises `ArmdError` if the daemon refuses it, or does not answer, and for a value with a
        semicolon, which Zenoh cannot carry.
        """
        for key, value in parameters.items():
            if ";" in value:
                raise ArmdError(f"{key}: found {value!r}, expected no semicolon")
        selector = ";".join(f"{key}={value}" for key, value in parameters.items())
        return str(self._ask(f"{keys.COMMAND}/{name}", selector).get("done", ""))

    def stream(self, what: str, waiting: int | None = None) -> Stream:
        """A subscription to poll, for a program with a loop of its own; *waiting* is how many may
        wait to be taken (1: only the newest is of interest), of events and measurements all do."""
        return Stream(self._session, self.serial, what, self._gate, waiting)

    @contextmanager
    def calling(self, what: str, callback: Callable[[bytes], None]) -> Iterator[None]:
        """Within this `with`, *callback* gets each payload as it arrives, in Zenoh's thread: for
        programs to which a fraction of a millisecond matters. It must be quick, must not call
        Zenoh, and must not be the reason that the `with` is never left.
        """

        def pass_on(sample: zenoh.Sample) -> None:
            payload = self._gate.payload(what, sample)
            if payload is not None:
                callback(payload)

        subscriber = self._session.declare_subscriber(keys.key(self.serial, what), pass_on)
        try:
            yield
        finally:
            subscriber.undeclare()  # type: ignore[no-untyped-call]

    def decode(self, payloads: list[bytes]) -> npt.NDArray[np.void]:
        """The next points of the stream, (n,) of `armd.POINT`; counts those lost before them."""
        points = np.frombuffer(b"".join(payloads), POINT)
        self.lost.count(points)
        return points

    def _messages(self, what: str, seconds: float | None) -> Iterator[dict[str, Any]]:
        with self.stream(what) as stream:
            for payloads in stream.follow(seconds):
                yield from map(json.loads, payloads)

    def _ask(self, what: str, parameters: str = "") -> dict[str, Any]:
        return self._checked(what, self._ask_bytes(what, parameters))

    def _checked(self, what: str, payload: bytes) -> dict[str, Any]:
        """The content of an answer; raises `ArmdError` where it has not the form of its key."""
        content = json_object(what, payload)
        if content is None:
            key = keys.key(self.serial, what)
            form = "message" if what in FORMS else "JSON object"
            raise ArmdError(f"{key}: found {payload[:40]!r}, expected armd's {form} of this key")
        return content

    def _ask_bytes(self, what: str, parameters: str = "") -> bytes:
        key = keys.key(self.serial, what)
        try:
            replies = self._session.get(f"{key}?{parameters}" if parameters else key)
        except zenoh.ZError:
            raise Closed("the connection to the arm is closed") from None
        for reply in replies:
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
            if reply.err is not None:
                reason = reply.err.payload.to_bytes().decode(errors="replace")
                raise ArmdError(f"{key}: {_shown(reason)}")
        raise NoAnswer(f"{key}: no answer; is the daemon running?")


def _shown(reason: str) -> str:
    """Text of whoever answers, fit for a terminal: no longer than a screen, nothing it obeys."""
    reason = cut(reason)
    return reason if reason.isprintable() else reason.encode("unicode_escape").decode()


def connect(serial: str | None = None, endpoint: str = ENDPOINT, timeout_s: float = 10.0) -> Arm:
    """Connect to a daemon; *serial* None takes the one arm that is there.

    *endpoint* may be a Zenoh configuration file instead (`*.json5`): for certificates and users.
    Raises `NoAnswer` if no arm (or none of that serial number) shows up in *timeout_s*, `ArmdError`
    if there are several and none was named, `BadInput` for a configuration that cannot be read.
    """
    session = open_session(endpoint, timeout_s)
    try:
        return Arm(session, find_arm(session, serial, endpoint, timeout_s))
    except BaseException:
        session.close()  # type: ignore[no-untyped-call]
        raise

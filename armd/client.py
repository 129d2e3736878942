"""A subscriber's view of an arm: connects, and iterates points. Needs no configuration of armd.

with armd.connect() as arm:
    for point in arm.points():
        print(point.seq, point.position_mm)
"""

from __future__ import annotations

import asyncio
import base64
import json
import math
import time
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
import numpy.typing as npt
import zenoh

from armd import keys
from armd.closing import Closing
from armd.errors import ArmdError, Closed, NoAnswer, shorten_text
from armd.point import POINT, Lost, Point
from armd.printable import to_printable
from armd.received import FORMS, Gate, Refused, parse_object
from armd.stream import POLL_S, Handle, Stream, subscribe
from armd.zenoh_session import ENDPOINT, convert_errors, find_arm, open_session


class Arm(Closing):
    """A connection to one arm's streams; close it, or use it in a `with`.

    - Iterators: `points`, `batches`, `points_async`, `measurements`, `events` and `health` give
      new messages, for ever or for *seconds*, and end when any thread closes the arm.
    - Snapshots: `latest`, `state`, `info` and `calibration_file` answer at once.
    - History: `past` gives the messages that the daemon still has.
    - Callbacks: `on_measurement` and `on_event` call a function.

    Iterate from one thread. Every error is an `ArmdError`: `NoAnswer` where nothing comes in time,
    `Closed` where this arm was closed before.
    """

    def __init__(self, session: zenoh.Session, serial: str) -> None:
        self._session = session
        self.serial = serial
        self.lost = Lost()
        self._gate = Gate()

    def __repr__(self) -> str:
        return f"<armd.Arm {self.serial}{', closed' * self._session.is_closed()}>"

    @property
    def refused(self) -> Refused:
        """The number of ignored messages on the arm's keys: malformed, or of another publisher."""
        return self._gate.refused

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    def points(self, seconds: float | None = None) -> Iterator[Point]:
        """Yield every point from now on, in order."""
        for batch in self.batches(seconds):
            yield from Point.from_array(batch)

    def batches(self, seconds: float | None = None) -> Iterator[npt.NDArray[np.void]]:
        """Yield arrays of `armd.POINT` with all points since the last array, at least one.

        Points between two iterations are not counted as lost.
        """
        self.lost.begin()
        with self.stream(keys.POINT) as stream:
            for payloads in stream.follow(seconds):
                yield self.decode(payloads)

    def latest(self, timeout_s: float = 1.0) -> Point:
        """Return the next point that comes; raises `NoAnswer` if none does within *timeout_s*."""
        for point in self.points(timeout_s):
            return point
        if self._session.is_closed():
            raise Closed("the connection to the arm is closed")
        raise NoAnswer(f"{self.serial}: no point within {timeout_s:g} s")

    def state(self) -> dict[str, Any]:
        """Return the last health message: state, reason, rates, temperatures. Raises `NoAnswer`."""
        return self._ask(keys.HEALTH)

    async def points_async(self, seconds: float | None = None) -> AsyncIterator[Point]:
        """Yield points as `points` does, for `async for`: other tasks run between points."""
        end_s = math.inf if seconds is None else time.monotonic() + seconds
        self.lost.begin()
        opened = await asyncio.to_thread(self.stream, keys.POINT)  # this queries the daemon
        with opened as stream, suppress(Closed):
            while time.monotonic() < end_s:
                for point in Point.from_array(self.decode(stream.take())):
                    yield point
                await asyncio.sleep(POLL_S)

    def on_measurement(
        self, call: Callable[[dict[str, Any]], object], past: bool = False
    ) -> Handle:
        """Call *call* with each new measurement, in a thread of Zenoh's.

        *past*: first with those that the daemon still has. Returns a handle; close it to end the
        calls. An exception that *call* raises is logged, and the next measurement comes all the
        same.
        """
        return self._on(keys.MEASUREMENT, call, past)

    def on_event(self, call: Callable[[dict[str, Any]], object], past: bool = False) -> Handle:
        """Call *call* with each new event; see `on_measurement`."""
        return self._on(keys.EVENT, call, past)

    def _on(self, topic_key: str, call: Callable[[dict[str, Any]], object], past: bool) -> Handle:
        def pass_on(sample: zenoh.Sample) -> None:
            payload = self._gate.payload(topic_key, sample)
            if payload is not None:
                call(json.loads(payload))

        subscriber = subscribe(self._session, keys.key(self.serial, topic_key), pass_on, past)
        return Handle(subscriber.undeclare)

    def health(self, seconds: float | None = None) -> Iterator[dict[str, Any]]:
        """Yield once a second: state, reason, rates, drops, temperatures, latency."""
        return self._messages(keys.HEALTH, seconds)

    def events(self, seconds: float | None = None, past: bool = True) -> Iterator[dict[str, Any]]:
        """Yield faults, recoveries, buttons, changes; past ones first, unless *past* is false."""
        return self._messages(keys.EVENT, seconds, past)

    def measurements(
        self, seconds: float | None = None, past: bool = True
    ) -> Iterator[dict[str, Any]]:
        """Yield averaged points, one per button press or rest.

        Past ones come first, unless *past* is false.
        """
        return self._messages(keys.MEASUREMENT, seconds, past)

    def health_now(self) -> dict[str, Any]:
        """Return `state`, of which this is the older name."""
        return self.state()

    def info(self) -> dict[str, Any]:
        """Return arm, calibration, units and payload layout."""
        return self._ask(keys.INFO)

    def calibration_file(self) -> str | None:
        """Return the active calibration file, byte for byte; None without one.

        Raises `ArmdError` for an answer that is no calibration.
        """
        data = self._ask_bytes(keys.CALIBRATION)
        if data == b"null":
            return None
        self._checked(keys.CALIBRATION, data)
        return data.decode()

    def past(self, what: str) -> list[dict[str, Any]]:
        """Return the messages that the daemon still has: at most a thousand, the oldest first.

        *what* is "measurement" or "event".
        """
        if what not in (keys.MEASUREMENT, keys.EVENT):
            expected = f"{keys.MEASUREMENT!r} or {keys.EVENT!r}"
            raise ArmdError(f"past: found {what!r}, expected {expected}")
        key = keys.key(self.serial, what)
        with convert_errors(self._session, key):
            replies = list(self._session.get(key, consolidation=zenoh.ConsolidationMode.NONE))
        payloads = [reply.ok.payload.to_bytes() for reply in replies if reply.ok]
        messages = [parse_object(what, payload) for payload in payloads]
        self._gate.refused.malformed += messages.count(None)
        return [message for message in messages if message is not None]

    def preamble(self) -> tuple[int, list[bytes]]:
        """Return the start of a recording of raw frames.

        It is the number of the next frame, and the frames, as published, that a decoder needs
        before it.
        """
        reply = self._ask(keys.RAW)
        try:
            return int(reply["next"]), [base64.b64decode(frame) for frame in reply["frames"]]
        except (KeyError, TypeError, ValueError) as error:
            raise ArmdError(f"{keys.RAW}: the answer is none of armd's: {error!r}") from error

    def command(self, name: str, /, **parameters: str) -> str:
        """Send a command, as `command("reload")` or `command("tip", name="ruby 3")`.

        Returns the daemon's description of its action. Raises `ArmdError` if the daemon refuses it,
        or does not answer, and for a value with a semicolon, which Zenoh cannot carry.
        """
        for key, value in parameters.items():
            if ";" in value:
                raise ArmdError(f"{key}: found {value!r}, expected no semicolon")
        selector = ";".join(f"{key}={value}" for key, value in parameters.items())
        return str(self._ask(f"{keys.COMMAND}/{name}", selector).get("done", ""))

    def stream(self, what: str, waiting: int | None = None) -> Stream:
        """Return a subscription to poll, for a program with its own loop.

        *waiting*: how many payloads may wait (1: only the newest is of interest); of events and
        measurements all wait.
        """
        return Stream(self._session, self.serial, what, self._gate, waiting)

    @contextmanager
    def calling(self, what: str, callback: Callable[[bytes], None]) -> Iterator[None]:
        """Call *callback* with each payload on its arrival, within this `with`.

        It runs in Zenoh's thread, for programs to which a fraction of a millisecond matters. It
        must be quick, must not call Zenoh, and must not prevent the end of the `with`.
        """

        def pass_on(sample: zenoh.Sample) -> None:
            payload = self._gate.payload(what, sample)
            if payload is not None:
                callback(payload)

        with Handle(
            subscribe(self._session, keys.key(self.serial, what), pass_on, False).undeclare
        ):
            yield

    def decode(self, payloads: list[bytes]) -> npt.NDArray[np.void]:
        """Return the next points of the stream, (n,) of `armd.POINT`; counts those lost before
        them.
        """
        points = np.frombuffer(b"".join(payloads), POINT)
        self.lost.count(points)
        return points

    def _messages(
        self, topic_key: str, seconds: float | None, past: bool = True
    ) -> Iterator[dict[str, Any]]:
        with Stream(self._session, self.serial, topic_key, self._gate, past=past) as stream:
            for payloads in stream.follow(seconds):
                yield from map(json.loads, payloads)

    def _ask(self, topic_key: str, parameters: str = "") -> dict[str, Any]:
        return self._checked(topic_key, self._ask_bytes(topic_key, parameters))

    def _checked(self, topic_key: str, payload: bytes) -> dict[str, Any]:
        """Return the content of an answer; raises `ArmdError` if it lacks the form of its key."""
        content = parse_object(topic_key, payload)
        if content is None:
            key = keys.key(self.serial, topic_key)
            form = "message" if topic_key in FORMS else "JSON object"
            raise ArmdError(f"{key}: found {payload[:40]!r}, expected armd's {form} of this key")
        return content

    def _ask_bytes(self, topic_key: str, parameters: str = "") -> bytes:
        key = keys.key(self.serial, topic_key)
        with convert_errors(self._session, key):
            for reply in self._session.get(f"{key}?{parameters}" if parameters else key):
                if reply.ok is not None:
                    return reply.ok.payload.to_bytes()
                if reply.err is not None:
                    reason = reply.err.payload.to_bytes().decode(errors="replace")
                    raise ArmdError(f"{key}: {to_printable(shorten_text(reason))}")
        raise NoAnswer(f"{key}: no answer; is the daemon running?")


def connect(serial: str | None = None, endpoint: str = ENDPOINT, timeout_s: float = 10.0) -> Arm:
    """Connect to a daemon; *serial* None takes the only arm.

    *endpoint* may be a Zenoh configuration file instead (`*.json5`): for certificates and users.
    Raises `NoAnswer` if no arm (or none of that serial number) appears within *timeout_s*,
    `ArmdError` if there are several and none was named, `BadInput` for a configuration that cannot
    be read.
    """
    session = open_session(endpoint, timeout_s)
    try:
        return Arm(session, find_arm(session, serial, endpoint, timeout_s))
    except BaseException:
        session.close()  # type: ignore[no-untyped-call]
        raise

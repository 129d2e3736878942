"""One arm's streams for the page; reconnects whenever the daemon comes back."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any

import numpy as np

import armd
from armd import POINT, Arm, joints_dtype, keys
from armd.daemon.bridges.process import close_soon, run_in_thread
from armd.daemon.bridges.view import page_messages
from armd.daemon.bridges.view.board import KEPT, Board
from armd.daemon.bridges.view.history import TemperatureHistory
from armd.errors import ArmdError
from armd.received import parse_object
from armd.stream import Stream

#: Rate of the tip's position on the page; the eye sees no more.
LIVE_HZ = 30.0
#: Health comes every second; without it for this long, the daemon counts as gone.
SILENT_S = 2.5
#: After this long without health the session is replaced: Zenoh does not recover it later.
GIVEN_UP_S = 15.0
CONNECT_S, RETRY_S = 5.0, 1.0
#: Only the newest points and joints are needed: Zenoh drops older ones at no cost.
NEWEST = 2


class Feed:
    """Puts the arm's messages on *board*.

    Points and joints are subscribed to only while a page is open.
    """

    def __init__(
        self, board: Board, serial: str | None, endpoint: str, watched: Callable[[], bool]
    ) -> None:
        self._board = board
        self._serial = serial
        self._endpoint = endpoint
        self._watched = watched
        self.history = TemperatureHistory()
        self.arm: Arm | None = None
        """While the daemon is there."""
        self.info: dict[str, Any] | None = None
        self.measured: Callable[[dict[str, Any]], None] = lambda measurement: None
        """Told of each measurement, those of the past too, once."""
        self._health: dict[str, Any] = {}
        self._heard_s = self._uptime_s = 0.0
        self._link_text = ""
        self._undescribed = ""  # why the page has no geometry, calibration and tip
        self._described: tuple[Any, ...] = ()  # calibration and tip of the last `info`
        self._asking: asyncio.Task[None] | None = None
        self._events: list[dict[str, Any]] = []
        self._message_keys: dict[tuple[str, int, str], None] = {}
        self.measurements: dict[str, dict[str, Any]] = {}
        """Measurements by the id that the page has of each, the last ones."""

    @property
    def serial(self) -> str | None:
        """The arm's serial number; None while it is unknown."""
        return self._serial

    @property
    def stamp_ns(self) -> int:
        """The daemon's clock in its last health message."""
        return int(self._health.get("stamp_ns", 0))

    async def run(self) -> None:
        """Follow the arm for ever."""
        self._say(False, "looking for the daemon")
        while True:
            try:
                arm = await run_in_thread(
                    lambda: armd.connect(self._serial, self._endpoint, CONNECT_S)
                )
            except ArmdError as error:
                self._say(False, str(error))
                await asyncio.sleep(RETRY_S)
                continue
            self._serial = arm.serial  # reconnect only to this arm
            try:
                await self._follow(arm)
            finally:
                self.arm = None
                close_soon(arm)

    async def _follow(self, arm: Arm) -> None:
        """Put the arm's messages on the board until the daemon is silent for too long."""
        self.arm, self._described, self._heard_s = arm, (), time.monotonic()
        with ExitStack() as stack:
            health = stack.enter_context(arm.stream(keys.HEALTH))
            events = stack.enter_context(arm.stream(keys.EVENT))
            measurements = stack.enter_context(arm.stream(keys.MEASUREMENT))
            live = stack.enter_context(_Live(arm))
            while time.monotonic() - self._heard_s < GIVEN_UP_S:
                await asyncio.sleep(1 / LIVE_HZ)
                for payload in events.take():
                    self._take_event(json.loads(payload))
                for payload in measurements.take():
                    self._take_measurement(json.loads(payload))
                for payload in health.take():
                    self._take_health(payload, arm)
                if time.monotonic() - self._heard_s > SILENT_S:
                    silent_s = time.monotonic() - self._heard_s
                    self._say(False, f"no word from the daemon for {silent_s:.0f} s")
                if (text := live.newest(self._watched())) is not None:
                    self._board.put("live", text)

    def _take_event(self, event: dict[str, Any]) -> None:
        if self._is_new("event", event["stamp_ns"], event["kind"] + event["text"]):
            self._events.append(event)
            del self._events[:-KEPT]
            self._board.append("event", page_messages.format_event(event))
            self._described = self._described if event["kind"] not in _CHANGES else ()

    def _take_measurement(self, measurement: dict[str, Any]) -> None:
        if self._is_new("measurement", measurement["stamp_ns"], str(measurement["seq"])):
            self._board.append("measurement", page_messages.format_measurement(measurement))
            self.measurements[page_messages.make_measurement_id(measurement)] = measurement
            if len(self.measurements) > KEPT:
                self.measurements.pop(next(iter(self.measurements)))
            self.measured(measurement)

    def _is_new(self, topic_key: str, stamp_ns: int, which: str) -> bool:
        """Return whether a message is new; every new session sends the past again."""
        key = topic_key, stamp_ns, which
        if key in self._message_keys:
            return False
        self._message_keys[key] = None
        if len(self._message_keys) > 2 * KEPT:
            self._message_keys.pop(next(iter(self._message_keys)))
        return True

    def _take_health(self, payload: bytes, arm: Arm) -> None:
        self._heard_s = time.monotonic()
        self._health = json.loads(payload)
        self._board.put("health", json.dumps(self._health))
        self.history.add(self._health)
        self._say(True, self._undescribed)
        if self._health["uptime_s"] < self._uptime_s:  # restarted, maybe with another arm.toml
            self._described = ()
        self._uptime_s = self._health["uptime_s"]
        described = self._health["calibration"], self._health["tip"]
        if described != self._described and (self._asking is None or self._asking.done()):
            self._asking = asyncio.ensure_future(self._ask(arm, described))

    async def _ask(self, arm: Arm, described: tuple[Any, ...]) -> None:
        """Ask for the arm's description, which seldom changes.

        Without an answer it is asked again with the next health message.
        """
        try:
            health, since_ms = self._health, self._since_ms()
            info, description = await run_in_thread(lambda: describe_arm(arm, health, since_ms))
        except ArmdError as error:
            self._undescribed = f"the daemon does not describe the arm: {error}; asking again"
            return
        self._undescribed = ""
        self.info, self._described = info, described
        self._board.put("arm", description)

    def _since_ms(self) -> dict[str, float]:
        """Return when the active calibration and the active tip became active."""
        started_ms = self._health["stamp_ns"] / 1e6 - 1000 * self._health["uptime_s"]
        since = dict.fromkeys(_CHANGES, started_ms)
        for event in self._events:
            if event["kind"] in since:
                since[event["kind"]] = max(started_ms, event["stamp_ns"] / 1e6)
        return since

    def _say(self, is_connected: bool, text: str) -> None:
        """Put on the board whether the daemon is there, and the reason if not."""
        link_text = json.dumps(
            {"here": is_connected, "text": text, "serial": self._serial, "endpoint": self._endpoint}
        )
        if link_text != self._link_text:
            self._link_text = link_text
            self._board.put("link", link_text)


def describe_arm(
    arm: Arm, health: Mapping[str, Any], since_ms: Mapping[str, float]
) -> tuple[dict[str, Any], str]:
    """Ask the daemon for the arm's description; return its info and the page's message.

    Raises `ArmdError` for a missing or invalid answer.
    """
    info, text = arm.info(), arm.calibration_file()
    calibration = None if text is None else parse_object(keys.CALIBRATION, text.encode())
    try:
        return info, page_messages.format_arm(info, calibration, health, since_ms)
    except (KeyError, TypeError) as error:
        raise ArmdError(f"its answer is none of armd's: {error!r}") from error


_CHANGES = ("calibration", "tip")


class _Live:
    """Points and joints, subscribed to while a page is open."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm
        self._streams: tuple[Stream, Stream] | None = None
        self._angles: list[float] | None = None

    def __enter__(self) -> _Live:
        return self

    def __exit__(self, *raised: object) -> None:
        self._end()

    def newest(self, watched: bool) -> str | None:
        """Return the page's message of the newest point since the last call, or None."""
        if not watched:
            self._end()
            return None
        if self._streams is None:
            point, joints = (
                self._arm.stream(topic_key, waiting=NEWEST)
                for topic_key in (keys.POINT, keys.JOINTS)
            )
            self._streams = point, joints
        points, angles = (stream.take() for stream in self._streams)
        if angles:
            n = int.from_bytes(angles[-1][16:20], "little")
            if len(angles[-1]) == joints_dtype(n).itemsize:
                row = np.frombuffer(angles[-1], joints_dtype(n))[0]
                self._angles = row["angle_rad"].tolist()
        return (
            page_messages.format_live(np.frombuffer(points[-1], POINT)[0], self._angles)
            if points
            else None
        )

    def _end(self) -> None:
        for stream in self._streams or ():
            stream.close()
        self._streams, self._angles = None, None

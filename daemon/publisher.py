"""Everything that leaves the daemon over Zenoh. docs/subscriber.md describes keys and payloads."""

from __future__ import annotations

import json
import os
from collections import deque
from collections.abc import Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
import zenoh
from zenoh import ext

from armd import POINT, POINT_ENCODING, keys
from armd.drivers import raw
from armd.drivers.sample import RawFrame

JSON = "application/json"
#: Measurements and events kept for subscribers who come late.
KEPT = 1000


class Publisher:
    """Publishes one arm, from its construction to `close`."""

    def __init__(self, session: zenoh.Session, serial: str) -> None:
        # DROP without express: a subscriber that stands still loses points, nobody else waits.
        drop = zenoh.CongestionControl.DROP
        self._point = session.declare_publisher(
            keys.key(serial, keys.POINT), encoding=POINT_ENCODING, congestion_control=drop
        )
        self._health = session.declare_publisher(
            keys.key(serial, keys.HEALTH), encoding=JSON, congestion_control=drop
        )
        self._raw = session.declare_publisher(keys.key(serial, keys.RAW), congestion_control=drop)
        self.next_raw_frame = 0  # its number
        self._recorded = False
        self.measurements = Kept(session, keys.key(serial, keys.MEASUREMENT))
        self.events = Kept(session, keys.key(serial, keys.EVENT))
        self.health: dict[str, Any] = {}
        self._alive = session.liveliness().declare_token(keys.key(serial, keys.ALIVE))

    def put_points(self, points: npt.NDArray[np.void]) -> None:
        """Publish an array of `POINT`, each on its own, in order."""
        put = self._point.put
        data = points.tobytes()
        for start in range(0, len(data), POINT.itemsize):
            put(data[start : start + POINT.itemsize])
        os.sched_yield()  # Zenoh's thread, which sends, may be waiting for this processor

    def look_for_recorders(self) -> None:
        """Asked now and then: it costs Zenoh too much to be asked for every sample."""
        status: Any = self._raw.matching_status  # Zenoh's stub calls it bool; it is always true
        self._recorded = status.matching

    def put_raw(self, frames: Iterable[RawFrame]) -> None:
        """Publish raw frames while somebody records them."""
        if self._recorded:
            for frame in frames:
                self._raw.put(raw.pack(self.next_raw_frame, frame))
                self.next_raw_frame += 1

    def put_health(self, health: dict[str, Any]) -> None:
        self.health = health
        self._health.put(json.dumps(health, allow_nan=False))

    def close(self) -> None:
        """Take the token away first: who watches it learns at once that the arm is gone."""
        self._alive.undeclare()  # type: ignore[no-untyped-call]


class Kept:
    """A JSON stream whose past a late subscriber can have.

    An advanced subscriber with history gets it by itself; any other by a plain `get` of the key.
    """

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.key = key
        self._publisher = ext.declare_advanced_publisher(
            session,
            key,
            encoding=JSON,
            congestion_control=zenoh.CongestionControl.DROP,
            cache=ext.CacheConfig(max_samples=KEPT),
            publisher_detection=True,
        )
        self._session = session
        self.past: deque[tuple[str, zenoh.Timestamp]] = deque(maxlen=KEPT)

    def put(self, content: dict[str, Any]) -> None:
        text = json.dumps(content, allow_nan=False)
        timestamp = self._session.new_timestamp()
        self.past.append((text, timestamp))
        self._publisher.put(text, timestamp=timestamp)

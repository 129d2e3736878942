"""Publish over Zenoh, with the keys and payloads of docs/reference/subscriber.md."""

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

from armd import JOINTS_ENCODING, POINT, POINT_ENCODING, joints_dtype, keys
from armd.daemon.live.pipeline import Joints, PointArray
from armd.drivers.replay import raw
from armd.drivers.sample import RawFrame, SampleArray

JSON = "application/json"
#: Measurements and events kept for late subscribers.
KEPT = 1000


class Publisher:
    """Publishes one arm, from its construction to `close`."""

    def __init__(self, session: zenoh.Session, serial: str) -> None:
        # DROP without express: a subscriber that stops reading loses points; no other one waits.
        drop = zenoh.CongestionControl.DROP
        self._point = session.declare_publisher(
            keys.key(serial, keys.POINT), encoding=POINT_ENCODING, congestion_control=drop
        )
        self._health = session.declare_publisher(
            keys.key(serial, keys.HEALTH), encoding=JSON, congestion_control=drop
        )
        self._joints = session.declare_publisher(
            keys.key(serial, keys.JOINTS), encoding=JOINTS_ENCODING, congestion_control=drop
        )
        self._joints_wanted = False
        self._raw = session.declare_publisher(keys.key(serial, keys.RAW), congestion_control=drop)
        self.next_raw_frame = 0  # number of the next frame
        self._recorded = False
        self.measurements = KeptStream(session, keys.key(serial, keys.MEASUREMENT))
        self.events = KeptStream(session, keys.key(serial, keys.EVENT))
        self.health: dict[str, Any] = {}
        self._alive = session.liveliness().declare_token(keys.key(serial, keys.ALIVE))

    def put_points(self, points: npt.NDArray[np.void]) -> None:
        """Publish an array of `POINT`, each point in a message, in order."""
        put = self._point.put
        data = points.tobytes()
        for start in range(0, len(data), POINT.itemsize):
            put(data[start : start + POINT.itemsize])
        os.sched_yield()  # Zenoh's sending thread may wait for this processor

    def put_joints(self, points: PointArray, samples: SampleArray, joints: Joints) -> None:
        """Publish the joints' motion at points (n,), while there are subscribers."""
        if not self._joints_wanted:
            return
        for message in encode_joint_messages(points, samples, joints):
            self._joints.put(message)

    def look_for_listeners(self) -> None:
        """Update whether there are subscribers of joints and raw frames.

        Call it now and then: it takes Zenoh too long for every sample.
        """
        self._recorded = _has_subscribers(self._raw)
        self._joints_wanted = _has_subscribers(self._joints)

    def put_raw(self, frames: Iterable[RawFrame]) -> None:
        """Publish raw frames while there is a subscriber."""
        if self._recorded:
            for frame in frames:
                self._raw.put(raw.pack(self.next_raw_frame, frame))
                self.next_raw_frame += 1

    def put_health(self, health: dict[str, Any]) -> None:
        self.health = health
        self._health.put(json.dumps(health, allow_nan=False))

    def health_text(self) -> str:
        """Return the last published health message, as JSON."""
        return json.dumps(self.health)

    def close(self) -> None:
        """Withdraw the liveliness token, so that watchers learn at once that the arm is gone."""
        self._alive.undeclare()  # type: ignore[no-untyped-call]


def _has_subscribers(publisher: zenoh.Publisher) -> bool:
    status: Any = publisher.matching_status  # always true itself, though Zenoh's stub has bool
    return bool(status.matching)


def encode_joint_messages(points: PointArray, samples: SampleArray, joints: Joints) -> list[bytes]:
    """Return one `armd.joints.v1` for each point."""
    n, n_joints = len(points), joints.q.shape[1]
    messages = np.zeros(n, joints_dtype(n_joints))
    messages["seq"] = points["seq"]
    messages["stamp_ns"] = points["stamp_ns"]
    messages["n"] = n_joints
    # The count of an invalid joint has no meaning.
    broken = (samples["joint_invalid"][:, None] >> np.arange(n_joints, dtype=np.uint16) & 1) != 0
    messages["angle_rad"] = np.where(broken, np.nan, joints.q[:n])
    messages["rate_rad_s"] = np.where(broken, np.nan, joints.rate[:n])
    return [message.tobytes() for message in messages]


class KeptStream:
    """A JSON stream of which a late subscriber can get the past.

    An advanced subscriber with history gets it automatically, any other by a plain `get` of the
    key.
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
        #: The same bytes that Zenoh's cache has, not copies.
        self.past: deque[tuple[zenoh.ZBytes, zenoh.Timestamp]] = deque(maxlen=KEPT)

    def put(self, content: dict[str, Any]) -> str:
        """Publish *content*, and return it as published."""
        text = json.dumps(content, allow_nan=False)
        payload, timestamp = zenoh.ZBytes(text), self._session.new_timestamp()
        self.past.append((payload, timestamp))
        self._publisher.put(payload, timestamp=timestamp)
        return text
